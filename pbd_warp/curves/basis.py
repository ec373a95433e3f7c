"""Cubic curves as simulation points and back: basis matrices, and their fit by least squares.

A segment of a cubic curve is S(t) = [t^3 t^2 t 1] M [P_0 P_1 P_2 P_3]^T with the basis' matrix M.
Source: UsdGeom.BasisCurves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from pbd_warp.errors import InputError, unknown

LINEAR = "linear"
WRAPS = NONPERIODIC, PERIODIC, PINNED = "nonperiodic", "periodic", "pinned"

BASES = {
    "bezier": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 3, 0, 0], [1, 0, 0, 0]], float),
    "bspline": np.array([[-1, 3, -3, 1], [3, -6, 3, 0], [-3, 0, 3, 0], [1, 4, 1, 0]]) / 6.0,
    "catmullRom": np.array([[-1, 3, -3, 1], [2, -5, 4, -1], [-1, 0, 1, 0], [0, 2, 0, 0]]) / 2.0,
}

LINKS = 3
"""Simulated links a segment: the fewest that tell all control points of every basis and wrap (a bezier's exactly)."""

PIN_WEIGHT = 1e6
"""Of a pinned point in the fit, against 1: the curve goes through it to 1e-12 of what is left elsewhere."""


@dataclass(frozen=True)
class Topology:
    """The curves of one BasisCurves prim.

    basis: "linear", or that of a cubic. wrap: as in USD. counts: control points of each curve, shape [curve_count].

    Raises:
        InputError: a basis or wrap that is unknown, a number of control points that makes no curve.
    """

    basis: str
    wrap: str
    counts: np.ndarray

    def __post_init__(self) -> None:
        if self.basis not in (LINEAR, *BASES):
            raise unknown("basis", self.basis, BASES)
        if self.wrap not in WRAPS:
            raise unknown("wrap", self.wrap, WRAPS)
        low, step = self._fewest()
        bad = np.flatnonzero((self.counts < low) | ((self.counts - low) % step != 0))
        if bad.size:
            more = f", or {step} more, or {2 * step} more ..." if step > 1 else " or more"
            raise InputError(
                f"curve {bad[0]} has {self.counts[bad[0]]} control points; "
                f"a {self.wrap} {self.basis} curve needs {low}{more}"
            )

    @property
    def closed(self) -> bool:
        return self.wrap == PERIODIC

    @property
    def segments(self) -> np.ndarray:
        """Of each curve, shape [curve_count]."""
        return np.array([self._segments(int(n)) for n in self.counts], int)

    @property
    def sample_counts(self) -> np.ndarray:
        """Simulation points of each curve: a linear one's own; of a cubic LINKS a segment, and an open one's end."""
        if self.basis == LINEAR:
            return self.counts
        return LINKS * self.segments + (0 if self.closed else 1)

    @property
    def varying_counts(self) -> np.ndarray:
        """ "varying" values of each curve: one where each segment begins, and one at the end of an open one."""
        return self.segments + (0 if self.closed else 1)

    def _fewest(self) -> tuple[int, int]:
        if self.basis == LINEAR:
            return (3 if self.closed else 2), 1
        if self.basis == "bezier":
            return (3 if self.closed else 4), 3
        return {NONPERIODIC: 4, PERIODIC: 3, PINNED: 2}[self.wrap], 1

    def _segments(self, n: int) -> int:
        low, step = self._fewest()
        if self.closed:
            return n // step
        return (n - low) // step + 1


def control_matrix(basis: str, wrap: str, n: int) -> np.ndarray:
    """What takes the n control points of one cubic curve to its simulation points, float64 [samples, n].

    "pinned" splines have a phantom point more at each end, 2 P_0 - P_1, so that they begin and end in their control
    points.
    """
    step = 3 if basis == "bezier" else 1
    phantom = wrap == PINNED and basis != "bezier"
    points = np.eye(n)
    if phantom:
        points = np.vstack([2 * points[0] - points[1], points, 2 * points[-1] - points[-2]])
    segments = Topology(basis, wrap, np.array([n])).segments[0]
    t = np.arange(LINKS) / LINKS
    weights = _powers(t) @ BASES[basis]
    rows = [weights @ points[(step * s + np.arange(4)) % len(points)] for s in range(segments)]
    if wrap != PERIODIC:
        rows.append(_powers(np.ones(1)) @ BASES[basis] @ points[step * (segments - 1) + np.arange(4)])
    return np.concatenate(rows)


def varying_matrix(basis: str, wrap: str, n: int) -> np.ndarray:
    """What takes the "varying" values of one cubic curve to its simulation points, linearly along each segment."""
    topology = Topology(basis, wrap, np.array([n]))
    values, samples = int(topology.varying_counts[0]), int(topology.sample_counts[0])
    at = np.arange(samples) / LINKS
    begin = np.floor(at).astype(int)
    matrix = np.zeros((samples, values))
    part = at - begin
    np.add.at(matrix, (np.arange(samples), begin % values), 1.0 - part)
    np.add.at(matrix, (np.arange(samples), (begin + 1) % values), part)
    return matrix


def _powers(t: np.ndarray) -> np.ndarray:
    return np.stack([t**3, t**2, t, np.ones_like(t)], axis=1)


class Sampling:
    """Takes values at the control points of a prim's curves to their simulation points."""

    def __init__(self, topology: Topology):
        self.topology = topology
        self.count = int(topology.sample_counts.sum())

    def vertex(self, values: np.ndarray) -> np.ndarray:
        """Values at control points [vertices, ...] at the simulation points [count, ...]."""
        return self._apply(values, self.topology.counts, control_matrix)

    def varying(self, values: np.ndarray) -> np.ndarray:
        """Values at the ends of segments [varying, ...] at the simulation points [count, ...]."""
        return self._apply(values, self.topology.varying_counts, varying_matrix)

    def uniform(self, values: np.ndarray) -> np.ndarray:
        """Values of curves [curve_count, ...] at the simulation points [count, ...]."""
        return np.repeat(values, self.topology.sample_counts, axis=0)

    def _apply(
        self, values: np.ndarray, counts: np.ndarray, matrix_of: Callable[[str, str, int], np.ndarray]
    ) -> np.ndarray:
        topology = self.topology
        if topology.basis == LINEAR:
            return values
        result = np.empty((self.count, *values.shape[1:]))
        for n, curves in _alike(topology.counts):
            matrix = matrix_of(topology.basis, topology.wrap, n)
            rows, columns = _places(topology.sample_counts, curves), _places(counts, curves)
            result[rows] = _each(matrix, values[columns])
        return result


class Fit:
    """Takes displacements (or velocities) of simulation points back to the control points, by least squares.

    Exact for whatever control points can do: rest, affine motion, any motion of a bezier. Curves go through their
    pinned points.

    Args:
        pinned: Which simulation points are pinned, bool [count].
    """

    def __init__(self, topology: Topology, pinned: np.ndarray):
        self._topology = topology
        self._parts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        if topology.basis == LINEAR:
            return
        for n, curves in _alike(topology.counts):
            matrix = control_matrix(topology.basis, topology.wrap, n)
            rows, columns = _places(topology.sample_counts, curves), _places(topology.counts, curves)
            patterns, pattern = np.unique(pinned[rows], axis=0, return_inverse=True)
            for number, held in enumerate(patterns):
                which = pattern.ravel() == number
                weight = np.where(held, PIN_WEIGHT, 1.0)
                q, r = np.linalg.qr(weight[:, None] * matrix)
                self._parts.append((rows[which], columns[which], np.linalg.solve(r, q.T * weight)))

    def __call__(self, displacement: np.ndarray) -> np.ndarray:
        """Of simulation points [samples, 3] to that of control points [vertices, 3]."""
        if self._topology.basis == LINEAR:
            return displacement
        result = np.empty((int(self._topology.counts.sum()), displacement.shape[1]))
        for rows, columns, matrix in self._parts:
            result[columns] = _each(matrix, displacement[rows])
        return result


def _each(matrix: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The matrix [m, n] times the values of each of many curves [curves, n, ...]."""
    return np.moveaxis(np.tensordot(matrix, values, (1, 1)), 0, 1)


def _alike(counts: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """The curves of each number of control points."""
    for n in np.unique(counts):
        yield int(n), np.flatnonzero(counts == n)


def _places(counts: np.ndarray, curves: np.ndarray) -> np.ndarray:
    """Where the values of some curves of equal counts lie among those of all, int [len(curves), count]."""
    first = np.cumsum(counts) - counts
    return first[curves, None] + np.arange(counts[curves[0]])
