"""Distance constraints of a model; the maths is in kernels/distance.py."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from pbd_warp.kernels.distance import limit_recovery, project_distance
from pbd_warp.step.constraints.parameters import Parameters

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


@dataclass(frozen=True)
class DistanceSet:
    """|x_i - x_j| = rest_length for each edge.

    edge: int32 [edge_count, 2]. rest_length [m], stiffness 0..1, compliance [m/N]: float64 [edge_count].
    """

    edge: np.ndarray
    rest_length: np.ndarray
    stiffness: np.ndarray
    compliance: np.ndarray

    def __len__(self) -> int:
        return len(self.edge)

    def valence(self, count: np.ndarray) -> None:
        """Add each particle's number of constraints to `count` [particle_count]."""
        np.add.at(count, self.edge.ravel(), 1)

    def residual(self, x: np.ndarray) -> np.ndarray:
        """C of every edge [m], float64 [edge_count]."""
        return np.linalg.norm(x[self.edge[:, 0]] - x[self.edge[:, 1]], axis=1) - self.rest_length

    def subset(self, which: np.ndarray) -> DistanceSet:
        """Some of the edges."""
        return DistanceSet(self.edge[which], self.rest_length[which], self.stiffness[which], self.compliance[which])

    def bind(self, sim: Simulation, name: str = "distance") -> BoundDistances:
        return BoundDistances(self, sim, name)


class BoundDistances:
    """Distance constraints on a simulation's device, in its precision."""

    def __init__(self, constraints: DistanceSet, sim: Simulation, name: str):
        self._sim = sim
        self.edge = sim.upload(f"{name}.edge", constraints.edge, wp.vec2i)
        self.rest_length = sim.upload(f"{name}.rest_length", constraints.rest_length)
        self.parameters = Parameters(sim, name, constraints.stiffness, constraints.compliance, sim.real)
        soft = (constraints.compliance > 0.0) | (constraints.stiffness < 1.0)
        self.recovering = LimitedLengths(sim, name, self.edge, self.rest_length, soft)

    def begin(self) -> None:
        self.parameters.begin()
        self.recovering.begin()

    def project(
        self, u: wp.array, share: wp.array | None, relaxation: float, residual: wp.array | None, correction: wp.array
    ) -> None:
        p = self.parameters
        sim = self._sim
        sim.launch(
            project_distance,
            len(self.edge),
            *(self.edge, self.recovering.rest_now, p.stiffness, p.compliance),
            *(sim.state.x, sim.w),
            *(u, share, relaxation, sim.per_force, sim.integrator.mean_gradient),
            *(p.lam, residual, correction),
        )


class LimitedLengths:
    """The lengths that a step asks for: the rest lengths, or, with a depenetration speed, as far towards them as that
    allows. Not of soft distances, bool [edge_count]: what they are off is their force."""

    def __init__(self, sim: Simulation, name: str, edge: wp.array, rest_length: wp.array, soft: np.ndarray):
        self._sim = sim
        self._edge, self._rest_length = edge, rest_length
        self.rest_now = rest_length
        if sim.depenetration_speed is not None:
            self._soft = sim.upload(f"{name}.soft", soft, wp.int32)
            self.rest_now = sim.allocate(f"{name}.rest_now", len(edge), sim.real)

    def begin(self) -> None:
        sim = self._sim
        if sim.depenetration_speed is not None:
            recovery = sim.depenetration_speed * abs(sim.stage_dt)
            sim.launch(
                limit_recovery,
                len(self._edge),
                *(self._edge, self._rest_length, self._soft, sim.state.x, recovery, self.rest_now),
            )
