"""NurbsCurves: rational B-splines of any order over any knots.

C(t) = sum_i N_i(t) w_i P_i / sum_i N_i(t) w_i with the B-splines N_i of the order over the knots.
Source: UsdGeom.NurbsCurves; Piegl and Tiller, The NURBS Book, algorithm A2.2 for the B-splines.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from pbd_warp.curves.sampling import Pattern, Weights
from pbd_warp.errors import InputError


@dataclass(frozen=True)
class NurbsKind:
    """The curves of one NurbsCurves prim.

    Args:
        counts: Control points of each curve, shape [curve_count]. order: degree + 1 of each curve.
        knots: count + order of each curve, one curve after the other. ranges: Shown part of each curve's knots, shape
            [curve_count, 2]; none: all there is. weights: Of the control points; none: 1.
        points: Control points, shape [total, 3]: a curve whose last ones lie on its first ones is a loop.

    Raises:
        InputError: numbers that do not add up.
    """

    counts: np.ndarray
    order: np.ndarray
    knots: np.ndarray
    ranges: np.ndarray
    weights: np.ndarray
    points: np.ndarray
    tangents: ClassVar[bool] = False

    def __post_init__(self) -> None:
        for name, there, needed in (
            ("order", len(self.order), len(self.counts)),
            ("knots", len(self.knots), int((self.counts + self.order).sum()) if len(self.order) else 0),
            ("ranges", len(self.ranges) or len(self.counts), len(self.counts)),
            ("pointWeights", len(self.weights) or len(self.points), len(self.points)),
        ):
            if there != needed:
                raise InputError(f"{name} must be {needed} for its curves, but there are {there}")

    @property
    def varying_counts(self) -> np.ndarray:
        """One where each span of knots begins, and one at the end."""
        return np.maximum(self.counts - self.order + 2, 0)

    @property
    def faults(self) -> dict[int, str]:
        return {curve: text for curve in range(len(self.counts)) if (text := self._fault(curve))}

    def _fault(self, curve: int) -> str:
        n, order = int(self.counts[curve]), int(self.order[curve])
        if order < 2 or n < order:
            return (
                f"it has {n} control points and order {order}; a curve needs an order of at least 2 and as many points"
            )
        knots, low, high = self._domain(curve)
        if not np.isfinite(knots).all() or np.any(np.diff(knots) < 0.0):
            return "its knots do not rise"
        if np.any(knots[order:-1] == knots[1:-order]):
            return f"a knot within it is there {order} times, so that it falls into pieces"
        if not knots[order - 1] <= low < high <= knots[n]:
            return f"its range {low:g} to {high:g} is not within its knots from {knots[order - 1]:g} to {knots[n]:g}"
        weights = self.weights[self._span(curve)] if len(self.weights) else np.ones(1)
        if not np.all(np.isfinite(weights) & (weights > 0.0)):
            return "its pointWeights are not above 0"
        return ""

    def key(self, curve: int) -> Hashable:
        weights = self.weights[self._span(curve)].tobytes() if len(self.weights) else b""
        knots, low, high = self._domain(curve)
        return int(self.counts[curve]), int(self.order[curve]), knots.tobytes(), low, high, weights, self._loop(curve)

    def pattern(self, curve: int) -> Pattern:
        n, order = int(self.counts[curve]), int(self.order[curve])
        knots, low, high = self._domain(curve)
        closed = self._loop(curve)
        # As many links a span as the degree: the fewest that tell all control points.
        ends = np.concatenate([[low], np.unique(knots[(knots > low) & (knots < high)]), [high]])
        links = order - 1
        t = (ends[:-1, None] + np.diff(ends)[:, None] * np.arange(links) / links).ravel()
        t = t if closed else np.append(t, high)
        span = np.clip(np.searchsorted(knots, t, side="right") - 1, order - 1, n - 1)
        span = np.where(knots[span] < knots[span + 1], span, np.searchsorted(knots, t, side="left") - 1)  # at the end
        weight = _bsplines(knots, order, span, t)
        index = span[:, None] - order + 1 + np.arange(order)
        if len(self.weights):
            weight = weight * self.weights[self._span(curve)][index]
            weight = weight / weight.sum(axis=1, keepdims=True)
        unknown = np.arange(n) % (n - links if closed else n)
        points = Weights(index, weight)
        part = (t - knots[span]) / (knots[span + 1] - knots[span])
        begin = span - order + 1
        varying = Weights(np.stack([begin, begin + 1], axis=1), np.stack([1.0 - part, part], axis=1))
        return Pattern(closed, points, points, varying, unknown)

    def _span(self, curve: int) -> slice:
        first = int(self._first[curve])
        return slice(first, first + int(self.counts[curve]))

    @cached_property
    def _first(self) -> np.ndarray:
        return np.cumsum(self.counts) - self.counts

    @cached_property
    def _first_knot(self) -> np.ndarray:
        return self._first + np.cumsum(self.order) - self.order

    def _domain(self, curve: int) -> tuple[np.ndarray, float, float]:
        """The knots of a curve, and from where to where it is shown."""
        n, order = int(self.counts[curve]), int(self.order[curve])
        first = int(self._first_knot[curve])
        knots = self.knots[first : first + n + order]
        low, high = self.ranges[curve] if len(self.ranges) else (knots[order - 1], knots[n])
        return knots, float(low), float(high)

    def _loop(self, curve: int) -> bool:
        """Whether its last control points lie on its first ones, and its knots go on beyond the end as they begin."""
        n, degree = int(self.counts[curve]), int(self.order[curve]) - 1
        knots, low, high = self._domain(curve)
        points = self.points[self._span(curve)]
        if n < 2 * degree + 1 or low != knots[degree] or high != knots[n]:
            return False
        gaps = np.diff(knots)
        again = gaps[n - degree : n + degree]
        return np.array_equal(points[:degree], points[n - degree :]) and np.allclose(
            gaps[: 2 * degree], again, atol=0.0
        )


def _bsplines(knots: np.ndarray, order: int, span: np.ndarray, t: np.ndarray) -> np.ndarray:
    """The B-splines that are not 0 at each t, shape [samples, order]; t lies in knots[span] .. knots[span + 1]."""
    values = np.ones((len(t), 1))
    for degree in range(1, order):
        raised = np.zeros((len(t), degree + 1))
        for k in range(degree):
            high, low = knots[span + k + 1], knots[span + k + 1 - degree]
            share = values[:, k] / (high - low)
            raised[:, k] += (high - t) * share
            raised[:, k + 1] += (t - low) * share
        values = raised
    return values
