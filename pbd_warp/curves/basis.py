"""BasisCurves: linear ones point by point, cubic ones by their basis.

A segment of a cubic curve is S(t) = [t^3 t^2 t 1] M [P_0 P_1 P_2 P_3]^T with the basis' matrix M.
Source: UsdGeom.BasisCurves.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pbd_warp.curves.sampling import Pattern, Weights
from pbd_warp.errors import unknown

LINEAR = "linear"
WRAPS = NONPERIODIC, PERIODIC, PINNED = "nonperiodic", "periodic", "pinned"

BASES = {
    "bezier": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]], float),
    "bspline": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6.0,
    "catmullRom": np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]]) / 2.0,
}

SAME = 1e-4
"""Links shorter than this part of a curve's mean link are none: doubled points, as exporters write and round them."""

LINKS = 3
"""Simulated links a segment: the fewest that tell all control points of every basis and wrap (a bezier's exactly)."""


@dataclass(frozen=True)
class BasisKind:
    """The curves of one BasisCurves prim.

    Args:
        basis: "linear", or that of a cubic. wrap: as in USD. counts: control points of each curve, shape [curve_count].
        points: Control points, shape [total, 3]: neighbours in a linear curve that lie in one place, but for SAME of
            its mean link, are simulated as one.

    Raises:
        InputError: a basis or wrap that is unknown.
    """

    basis: str
    wrap: str
    counts: np.ndarray
    points: np.ndarray
    tangents: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.basis not in (LINEAR, *BASES):
            raise unknown("basis", self.basis, BASES)
        if self.wrap not in WRAPS:
            raise unknown("wrap", self.wrap, WRAPS)

    @property
    def closed(self) -> bool:
        return self.wrap == PERIODIC

    @property
    def segments(self) -> np.ndarray:
        """Of each curve, shape [curve_count]."""
        low, step = self._fewest()
        return np.maximum(self.counts // step if self.closed else (self.counts - low) // step + 1, 0)

    @property
    def varying_counts(self) -> np.ndarray:
        """ "varying" values of each curve: one where each segment begins, and one at the end of an open one."""
        return self.segments + (0 if self.closed else 1)

    @property
    def faults(self) -> dict[int, str]:
        low, step = self._fewest()
        more = f", or {step} more, or {2 * step} more ..." if step > 1 else " or more"
        needs = f"a {self.wrap} {self.basis} curve needs {low}{more}"
        bad = np.flatnonzero((self.counts < low) | ((self.counts - low) % step != 0))
        faults = {curve: f"it has {self.counts[curve]} control points; {needs}" for curve in bad.tolist()}
        if self.basis == LINEAR:
            for curve in set(np.flatnonzero(self.counts > 0).tolist()) - faults.keys():
                places = int(self._place[self._span(curve)].max()) + 1
                if places < low:
                    faults[curve] = f"its {self.counts[curve]} points lie in {places} places; {needs}"
        return faults

    def key(self, curve: int) -> Hashable:
        if self.basis != LINEAR:
            return int(self.counts[curve])
        return self._place[self._span(curve)].tobytes()

    def pattern(self, curve: int) -> Pattern:
        return self._linear(self._place[self._span(curve)]) if self.basis == LINEAR else self._cubic(curve)

    def _linear(self, place: np.ndarray) -> Pattern:
        first = np.unique(place, return_index=True)[1][:, None]
        copy = Weights(first, np.ones(first.shape))
        return Pattern(self.closed, copy, copy, copy, place)

    def _cubic(self, curve: int) -> Pattern:
        n, segments = int(self.counts[curve]), int(self.segments[curve])
        step = 3 if self.basis == "bezier" else 1
        part = np.arange(LINKS * segments + (0 if self.closed else 1)) / LINKS
        segment = np.minimum(np.floor(part).astype(int), segments - 1)
        t = part - segment
        index = step * segment[:, None] + np.arange(4)
        weight = np.stack([t**3, t**2, t, np.ones_like(t)], axis=1) @ BASES[self.basis]
        if self.wrap == PINNED and self.basis != "bezier":
            index, weight = _without_phantoms(index - 1, weight, n)
        points = Weights(index % n, weight)
        ends = np.stack([segment, segment + 1], axis=1)
        varying = Weights(ends % int(self.varying_counts[curve]), np.stack([1.0 - t, t], axis=1))
        return Pattern(self.closed, points, points, varying, np.arange(n))

    def _fewest(self) -> tuple[int, int]:
        """Control points of the shortest curve, and by how many another segment takes more."""
        if self.basis == LINEAR:
            return (3 if self.closed else 2), 1
        if self.basis == "bezier":
            return (3 if self.closed else 4), 3
        return {NONPERIODIC: 4, PERIODIC: 3, PINNED: 2}[self.wrap], 1

    @cached_property
    def _first(self) -> np.ndarray:
        return np.cumsum(self.counts) - self.counts

    def _span(self, curve: int) -> slice:
        return slice(self._first[curve], self._first[curve] + self.counts[curve])

    @cached_property
    def _place(self) -> np.ndarray:
        """Of linear curves: numbers of the places that the points of each lie in, one after the other, from 0 on."""
        step = np.zeros(len(self.points))
        step[1:] = np.linalg.norm(np.diff(self.points, axis=0), axis=1)
        step[self._first[self.counts > 0]] = 0.0
        curve = np.repeat(np.arange(len(self.counts)), self.counts)
        least = SAME * np.bincount(curve, step, len(self.counts)) / np.maximum(self.counts - 1, 1)
        new = (step > least[curve]).astype(int)
        first = self._first[self.counts > 0]
        place = np.cumsum(new)
        place -= np.repeat(place[first], self.counts[self.counts > 0])
        if self.closed:
            for number in np.flatnonzero(self.counts > 1).tolist():
                span = self._span(number)
                own, last = place[span], place[span].max()
                if np.linalg.norm(self.points[span][-1] - self.points[span.start]) <= least[number]:
                    own[own == last] = 0
        return place


def _without_phantoms(index: np.ndarray, weight: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """ "pinned" splines have a phantom point more at each end, 2 P_0 - P_1, so that they begin and end in their control
    points; here its weight goes to the two points that make it."""
    before, after = index < 0, index >= n
    inner = np.stack([np.where(phantom, -weight, 0.0).sum(axis=1) for phantom in (before, after)], axis=1)
    weight = np.concatenate([np.where(before | after, 2.0 * weight, weight), inner], axis=1)
    second = np.broadcast_to([1, n - 2], inner.shape)
    return np.concatenate([np.clip(index, 0, n - 1), second], axis=1), weight
