"""What a simulation is doing, measured in float64 on the host."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd_warp.forces import Forces
from pbd_warp.simulation import Simulation
from pbd_warp.step.constraints.link_contact import capsules
from pbd_warp.step.divergence import STRETCHED


@dataclass(frozen=True)
class Measures:
    """One moment of a simulation.

    residual: Largest |C| [m] of what should hold exactly: distances and points without compliance, overlaps of
        particles in contact and with colliders.
    max_stretch: Largest | |x_i - x_j| / rest_length - 1 | of all distances (of rest length above 0).
    stretched: Distances without compliance that are off by more than STRETCHED of their length (step/divergence.py).
    overlap: Deepest overlap of two particles or links in contact, or of a particle and a collider [m].
    energy: Kinetic, in gravity (0 at the origin's height), in compliant constraints and in bending [J].
    kinetic: The first of these [J]. bending: The last [J].
    max_curvature: Largest of what resists bending, |kb| / l [1/m]; `BendingSet.curvature` has it of every triple.
    momentum [kg m/s], angular_momentum about the origin [kg m^2/s]: of all free particles, shape [3].
    forces: Tensions, reactions and contact forces of the last step; None where the method does not keep them.
    crossings: How often a link passed through another so far; None where nobody watches (`sim.watch_crossings`).
    """

    residual: float
    max_stretch: float
    stretched: int
    overlap: float
    energy: float
    kinetic: float
    bending: float
    max_curvature: float
    momentum: np.ndarray
    angular_momentum: np.ndarray
    forces: Forces | None
    crossings: int | None


@dataclass(frozen=True)
class CopyMeasures:
    """`Measures` of each copy of a replicated model: arrays [copy_count], vectors [copy_count, 3].

    All nan where the copy has diverged (`Simulation.failures`).
    """

    residual: np.ndarray
    max_stretch: np.ndarray
    stretched: np.ndarray
    overlap: np.ndarray
    energy: np.ndarray
    kinetic: np.ndarray
    bending: np.ndarray
    max_curvature: np.ndarray
    momentum: np.ndarray
    angular_momentum: np.ndarray


LARGEST = ("residual", "max_stretch", "overlap", "max_curvature")
"""Of which all copies together have that of the worst."""


def measure(sim: Simulation) -> Measures:
    """Measure a simulation as it is now, all copies together; reads the state back from the device."""
    with np.errstate(all="ignore"):
        each = _measure(sim)
        largest = {name: float(np.max(getattr(each, name))) for name in LARGEST}
        return Measures(
            **largest,
            stretched=int(np.sum(each.stretched)),
            energy=float(np.sum(each.energy)),
            kinetic=float(np.sum(each.kinetic)),
            bending=float(np.sum(each.bending)),
            momentum=each.momentum.sum(axis=0),
            angular_momentum=each.angular_momentum.sum(axis=0),
            forces=sim.forces if sim.keeps_forces else None,
            crossings=len(sim.crossings) if sim.watches_crossings else None,
        )


def measure_copies(sim: Simulation) -> CopyMeasures:
    """Measure each copy of a simulation as it is now; one copy where its model is not replicated."""
    with np.errstate(all="ignore"):
        each = _measure(sim)
    for values in vars(each).values():
        values[list(sim.failures)] = np.nan
    return each


def _measure(sim: Simulation) -> CopyMeasures:
    model = sim.model
    x = sim.state.x.numpy().astype(np.float64)
    v = sim.state.v.numpy().astype(np.float64)
    m = model.mass
    edges, points = model.distance, model.point
    c = edges.residual(x)
    c_point = np.zeros(0) if sim.point_target is None else points.residual(x, sim.point_target.numpy())

    def by_copy(values: np.ndarray) -> np.ndarray:
        return values.reshape(model.copy_count, -1, *values.shape[1:])

    def largest(values: np.ndarray) -> np.ndarray:
        return np.max(np.abs(by_copy(values)), axis=1, initial=0.0)

    def total(values: np.ndarray) -> np.ndarray:
        return np.sum(by_copy(values), axis=1)

    kinetic = total(0.5 * m * np.sum(v * v, axis=1))
    stretch = np.divide(c, edges.rest_length, out=np.zeros_like(c), where=edges.rest_length > 0.0)
    overlap = np.maximum(_pair_overlap(sim, x), _link_overlap(sim, x))
    overlap = np.maximum(overlap, largest(np.where(model.w > 0.0, sim.collider_overlaps[0], 0.0)))
    rigid = largest(np.where(edges.compliance == 0.0, c, 0.0))
    rigid_points = largest(np.where(points.compliance == 0.0, c_point, 0.0))
    bending = total(model.bending.energy(x))
    elastic = total(_elastic(c, edges.compliance)) + total(_elastic(c_point, points.compliance))
    return CopyMeasures(
        residual=np.maximum(np.maximum(rigid, rigid_points), overlap),
        max_stretch=largest(stretch),
        stretched=total(~(np.abs(stretch) <= STRETCHED) & (edges.compliance == 0.0)).astype(np.float64),
        overlap=overlap,
        energy=kinetic - total(m * np.sum(x * model.gravity, axis=1)) + elastic + bending,
        kinetic=kinetic,
        bending=bending,
        max_curvature=largest(model.bending.curvature(x)),
        momentum=total(m[:, None] * v),
        angular_momentum=total(m[:, None] * np.cross(x, v)),
    )


def _elastic(c: np.ndarray, compliance: np.ndarray) -> np.ndarray:
    return np.divide(0.5 * c**2, compliance, out=np.zeros_like(c), where=compliance > 0.0)


def _pair_overlap(sim: Simulation, x: np.ndarray) -> np.ndarray:
    """Deepest of each copy."""
    model, pair = sim.model, sim.contact_pairs
    i, j = pair[pair[:, 1] >= 0].T
    deepest = np.zeros(model.copy_count)
    np.maximum.at(
        deepest, i // model.copy_size, model.radius[i] + model.radius[j] - np.linalg.norm(x[i] - x[j], axis=1)
    )
    return deepest


def _link_overlap(sim: Simulation, x: np.ndarray) -> np.ndarray:
    """Deepest of each copy."""
    model, pair = sim.model, sim.link_pairs
    deepest = np.zeros(model.copy_count)
    if not len(pair):
        return deepest
    ends, _ = capsules(model)
    a, b = ends[pair[pair[:, 1] >= 0].T]
    far, s, t = segment_distance(x[a], x[b])
    r = model.radius
    depth = (1.0 - s) * r[a[:, 0]] + s * r[a[:, 1]] + (1.0 - t) * r[b[:, 0]] + t * r[b[:, 1]] - far
    np.maximum.at(deepest, a[:, 0] // model.copy_size, depth)
    return deepest


def segment_distance(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far segments are apart [m], and where on either of them, 0..1: the least of an end of one and all of the
    other, four times, and of both lines inside both segments.

    Args:
        a, b: Both ends, float64 [n, 2, 3].
    """
    one, other = a[:, 1] - a[:, 0], b[:, 1] - b[:, 0]
    zero = np.zeros(len(a))
    ways = [(zero + end, _nearest(a[:, end], b[:, 0], other)) for end in (0, 1)]
    ways += [(_nearest(b[:, end], a[:, 0], one), zero + end) for end in (0, 1)]
    normal = np.cross(one, other)
    size = np.sum(normal**2, axis=1)
    with np.errstate(all="ignore"):
        s = np.sum(np.cross(b[:, 0] - a[:, 0], other) * normal, axis=1) / size
        t = np.sum(np.cross(b[:, 0] - a[:, 0], one) * normal, axis=1) / size
        inside = (size > 0.0) & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    ways.append((np.where(inside, s, 0.0), np.where(inside, t, ways[0][1])))
    s, t = (np.stack(column) for column in zip(*ways, strict=True))
    away = a[:, 0] + s[..., None] * one - b[:, 0] - t[..., None] * other
    far = np.linalg.norm(away, axis=2)
    best = np.argmin(far, axis=0), np.arange(len(a))
    return far[best], s[best], t[best]


def _nearest(point: np.ndarray, start: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Where on a segment the point of it is that is nearest to another, 0..1."""
    size = np.sum(along**2, axis=1)
    there = np.sum((point - start) * along, axis=1)
    return np.clip(np.divide(there, size, out=np.zeros(len(size)), where=size > 0.0), 0.0, 1.0)
