"""Point constraints of a model; the maths is in kernels/point.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from pbd_warp.kernels.point import project_point
from pbd_warp.step.constraints.parameters import Parameters

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


@dataclass(frozen=True)
class PointSet:
    """x_i = target for each locked particle.

    particle: int32 [point_count]. target [m]: float64 [point_count, 3]. stiffness 0..1 and
    compliance [m/N]: float64 [point_count].
    """

    particle: np.ndarray
    target: np.ndarray
    stiffness: np.ndarray
    compliance: np.ndarray

    def __len__(self) -> int:
        return len(self.particle)

    def valence(self, count: np.ndarray) -> None:
        """Add each particle's number of constraints to `count` [particle_count]."""
        np.add.at(count, self.particle, 1)

    def residual(self, x: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Distance of each locked particle from its target [m], float64 [point_count]."""
        return np.linalg.norm(x[self.particle] - target, axis=1)

    def bind(self, sim: Simulation) -> BoundPoints:
        return BoundPoints(self, sim)


class BoundPoints:
    """Point constraints on a simulation's device, in its precision. `target` may be written between frames."""

    def __init__(self, constraints: PointSet, sim: Simulation):
        self._sim = sim
        self.particle = sim.upload("point.particle", constraints.particle, wp.int32)
        self.target = sim.upload("point.target", constraints.target, sim.vec3)
        self.parameters = Parameters(sim, "point", constraints.stiffness, constraints.compliance, sim.vec3)
        self.begin = self.parameters.begin

    def project(
        self, u: wp.array, share: wp.array | None, relaxation: float, residual: wp.array | None, correction: wp.array
    ) -> None:
        p = self.parameters
        sim = self._sim
        sim.launch(
            project_point,
            len(self.particle),
            *(self.particle, self.target, p.stiffness, p.compliance),
            *(sim.state.x, sim.w),
            *(u, share, relaxation, sim.per_force, sim.integrator.mean_gradient),
            *(p.lam, residual, correction),
        )
