"""Curves as simulation points: which control values make each point, assembled from patterns of single curves."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np


@dataclass(frozen=True)
class Weights:
    """Makes values at simulation points: the sum of weight[s, k] * values[index[s, k]].

    index: int [samples, k]. weight: float64 [samples, k].
    """

    index: np.ndarray
    weight: np.ndarray

    def __call__(self, values: np.ndarray) -> np.ndarray:
        """Values [n, ...] at the simulation points [samples, ...]."""
        return np.einsum("sk,sk...->s...", self.weight, values[self.index])

    @property
    def copies(self) -> bool:
        """Whether each simulation point is one of the values as it is."""
        return self.index.shape[1] == 1 and bool(np.all(self.weight == 1.0))


@dataclass(frozen=True)
class Pattern:
    """How one curve is simulated.

    closed: Whether its last simulation point is joined to its first.
    points: From its control values: control points, and for Hermite curves the tangents after them.
    vertex, varying: From primvars of these interpolations.
    unknown: Control values of the same number always move together, int [values].
    """

    closed: bool
    points: Weights
    vertex: Weights
    varying: Weights
    unknown: np.ndarray

    @property
    def samples(self) -> int:
        return len(self.points.index)


class Kind(Protocol):
    """What a type of curves has to say of the curves of one prim; counts are int [curve_count].

    counts: Control points. varying_counts: Values of interpolation "varying". tangents: Whether control values are the
    points of all curves, then tangents of all curves. faults: Why some make no curve.
    """

    tangents: ClassVar[bool]

    @property
    def counts(self) -> np.ndarray: ...
    @property
    def varying_counts(self) -> np.ndarray: ...
    @property
    def faults(self) -> dict[int, str]: ...

    def key(self, curve: int) -> Hashable:
        """Equal for curves of the same pattern."""

    def pattern(self, curve: int) -> Pattern: ...


class Sampling:
    """All simulated curves of a prim as simulation points, one after the other.

    Args:
        kind: Of the curves.
        simulated: Which of them, bool [curve_count]; the others have no simulation points.

    Attributes:
        sample_counts: Simulation points of each curve, int [curve_count].
        closed: Which curves are loops, bool [curve_count].
        count: Simulation points of all curves.
        points, vertex, varying: Weights of the whole prim.
        unknown: Number of the unknown that each control value moves with, -1 for those that do not move.
    """

    def __init__(self, kind: Kind, simulated: np.ndarray):
        self.kind = kind
        curve_count = len(kind.counts)
        groups: dict[Hashable, list[int]] = {}
        for curve in np.flatnonzero(simulated).tolist():
            groups.setdefault(kind.key(curve), []).append(curve)
        patterns = [(kind.pattern(curves[0]), np.array(curves)) for curves in groups.values()]
        self.sample_counts = np.zeros(curve_count, int)
        self.closed = np.zeros(curve_count, bool)
        unknowns = np.zeros(curve_count, int)
        for pattern, curves in patterns:
            self.sample_counts[curves] = pattern.samples
            self.closed[curves] = pattern.closed
            unknowns[curves] = pattern.unknown.max() + 1
        self.count = int(self.sample_counts.sum())
        first_sample, first_point = _firsts(self.sample_counts), _firsts(kind.counts)
        first_varying, first_unknown = _firsts(kind.varying_counts), _firsts(unknowns)
        total = int(kind.counts.sum())
        self.value_count = 2 * total if kind.tangents else total
        self.unknown = np.full(self.value_count, -1)
        self.unknown_count = int(unknowns.sum())
        widest = {n: max((getattr(p, n).index.shape[1] for p, _ in patterns), default=1) for n in _WEIGHTS}
        whole = {n: Weights(np.zeros((self.count, k), int), np.zeros((self.count, k))) for n, k in widest.items()}
        for pattern, curves in patterns:
            rows = first_sample[curves, None] + np.arange(pattern.samples)
            own = np.arange(len(pattern.unknown))
            n = int(kind.counts[curves[0]])
            values = first_point[curves, None] + np.where(own < n, own, total + own - n)
            self.unknown[values] = first_unknown[curves, None] + pattern.unknown
            for name, first in ("points", values), ("vertex", first_point), ("varying", first_varying):
                part: Weights = getattr(pattern, name)
                k = part.index.shape[1]
                places = values[:, part.index] if name == "points" else first[curves, None, None] + part.index
                whole[name].index[rows] = places[..., :1]  # where a pattern has fewer weights than the widest
                whole[name].index[rows, :k] = places
                whole[name].weight[rows, :k] = part.weight
        self.points, self.vertex, self.varying = (whole[name] for name in _WEIGHTS)

    def uniform(self, values: np.ndarray) -> np.ndarray:
        """Values of curves [curve_count, ...] at the simulation points [count, ...]."""
        return np.repeat(values, self.sample_counts, axis=0)

    def to_varying(self, values: np.ndarray) -> np.ndarray:
        """Values of simulation points [count] at the places of "varying" values, each from the nearest point; 0 of
        curves that are not simulated."""
        if self.points.copies:  # every control point is such a place; several in one have one simulation point
            return np.where(self.unknown >= 0, values[self.unknown], 0.0)
        out = np.zeros(int(self.kind.varying_counts.sum()))
        order = np.argsort(self.varying.weight, axis=None, kind="stable")  # the nearest last, so that it stays
        sample = np.repeat(np.arange(self.count), self.varying.index.shape[1])
        out[self.varying.index.ravel()[order]] = values[sample[order]]
        return out

    @property
    def curve(self) -> np.ndarray:
        """The curve of each simulation point, int [count]."""
        return np.repeat(np.arange(len(self.sample_counts)), self.sample_counts)

    @property
    def first(self) -> np.ndarray:
        """The first simulation point of each simulated curve, int."""
        return _firsts(self.sample_counts)[self.sample_counts > 0]

    @property
    def last(self) -> np.ndarray:
        """The last simulation point of each simulated curve, int."""
        return (self.first + self.sample_counts[self.sample_counts > 0]) - 1

    @cached_property
    def edges(self) -> np.ndarray:
        """Links between the simulation points, int [links, 2], along each curve; a closed one's last to its first."""
        end = np.arange(1, self.count + 1)
        closed = self.closed[self.sample_counts > 0]
        end[self.last[closed]] = self.first[closed]
        edges = np.stack([np.arange(self.count), end], axis=1)
        return np.delete(edges, self.last[~closed], axis=0)


_WEIGHTS = ("points", "vertex", "varying")


def _firsts(counts: np.ndarray) -> np.ndarray:
    return np.cumsum(counts) - counts
