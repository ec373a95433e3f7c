"""What a simulation is doing, measured in float64 on the host."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd_warp.forces import Forces
from pbd_warp.kernels.shapes import SPHERE
from pbd_warp.simulation import Simulation
from pbd_warp.step.divergence import STRETCHED


@dataclass(frozen=True)
class Measures:
    """One moment of a simulation.

    residual: Largest |C| [m] of what should hold exactly: distances and points without compliance, overlaps of
        particles in contact and with colliders.
    max_stretch: Largest | |x_i - x_j| / rest_length - 1 | of all distances (of rest length above 0).
    stretched: Distances without compliance that are off by more than STRETCHED of their length (step/divergence.py).
    overlap: Deepest overlap of two particles in contact, or of a particle and a collider [m].
    energy: Kinetic, in gravity (0 at the origin's height) and in compliant constraints [J].
    kinetic: The first of these [J].
    momentum [kg m/s], angular_momentum about the origin [kg m^2/s]: of all free particles, shape [3].
    forces: Tensions, reactions and contact forces of the last step; None where the method does not keep them.
    """

    residual: float
    max_stretch: float
    stretched: int
    overlap: float
    energy: float
    kinetic: float
    momentum: np.ndarray
    angular_momentum: np.ndarray
    forces: Forces | None


def measure(sim: Simulation) -> Measures:
    """Measure a simulation as it is now; reads the state back from the device."""
    with np.errstate(all="ignore"):
        return _measure(sim)


def _measure(sim: Simulation) -> Measures:
    model = sim.model
    x = sim.state.x.numpy().astype(np.float64)
    v = sim.state.v.numpy().astype(np.float64)
    m = model.mass

    edges, points = model.distance, model.point
    c = edges.residual(x)
    c_point = np.zeros(0) if sim.point_target is None else points.residual(x, sim.point_target.numpy())
    rated = edges.rest_length > 0.0
    stretch = c[rated] / edges.rest_length[rated]
    overlap = max(_pair_overlap(sim, x), _collider_overlap(sim, x))
    elastic = _elastic(c, edges.compliance) + _elastic(c_point, points.compliance)
    kinetic = float(0.5 * m @ np.sum(v * v, axis=1))
    return Measures(
        residual=max(_largest(c[edges.compliance == 0.0]), _largest(c_point[points.compliance == 0.0]), overlap),
        max_stretch=_largest(stretch),
        stretched=int(np.count_nonzero(~(np.abs(stretch[edges.compliance[rated] == 0.0]) <= STRETCHED))),
        overlap=overlap,
        energy=kinetic - float(m @ (x @ model.gravity)) + elastic,
        kinetic=kinetic,
        momentum=m @ v,
        angular_momentum=m @ np.cross(x, v),
        forces=sim.forces if sim.settings.method.keeps_forces else None,
    )


def _largest(values: np.ndarray) -> float:
    return float(np.max(np.abs(values), initial=0.0))


def _elastic(c: np.ndarray, compliance: np.ndarray) -> float:
    compliant = compliance > 0.0
    return float(np.sum(0.5 * c[compliant] ** 2 / compliance[compliant]))


def _pair_overlap(sim: Simulation, x: np.ndarray) -> float:
    pair = sim.contact_pairs
    i, j = pair[pair[:, 1] >= 0].T
    depth = sim.model.radius[i] + sim.model.radius[j] - np.linalg.norm(x[i] - x[j], axis=1)
    return float(np.max(depth, initial=0.0))


def _collider_overlap(sim: Simulation, x: np.ndarray) -> float:
    model, deepest = sim.model, float(np.max(sim.collider_overlaps[0], initial=0.0))
    free = model.w > 0.0
    c = model.colliders
    for which in np.flatnonzero((c.kind <= SPHERE) & (c.moves == 0)):
        away = x[free] - c.centre[which]
        ball = c.kind[which] == SPHERE
        surface = np.linalg.norm(away, axis=1) - c.size[which, 0] if ball else away @ c.size[which]
        deepest = max(deepest, float(np.max(model.radius[free] - surface, initial=0.0)))
    return deepest
