"""Implicit midpoint: second order, keeps energy and angular momentum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from pbd_warp.kernels.midpoint import predict_midpoint, update_midpoint
from pbd_warp.step.integrators.second_order import refuse_first_order_features

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


class Midpoint:
    """p = x + dt v + dt^2/2 a, forces along the gradient of the mean configuration, v = 2 u / dt - v.

    Source: kernels/midpoint.py. With `Direct` energy and angular momentum are kept to round-off, for every step that it
    converges in. Nothing is damped: what a step too long for a whip puts into the fast modes stays there.
    """

    name = "midpoint"
    order = 2
    stages: tuple[float, ...] = (1.0,)
    mean_gradient = True

    def __init__(self, sim: Simulation):
        refuse_first_order_features(self.name, sim)
        self._sim = sim
        self._gravity = sim.vec3(*sim.model.gravity)
        self._per_force = [
            sim.upload(f"per_force.{number}", [2.0 / (stage * sim.substep_dt) ** 2])
            for number, stage in enumerate(self.stages)
        ]

    def per_force(self, stage: int) -> wp.array:
        """2 / dt^2, with the dt of the stage."""
        return self._per_force[stage]

    def predict(self, dt: float, part: float) -> None:
        sim = self._sim
        sim.launch(
            predict_midpoint,
            len(sim.u),
            *(self._gravity, sim.state.x, sim.state.v, sim.w, dt),
            *(sim.grabbed, sim.grab_target, part),
            sim.u,
        )

    def update(self, dt: float) -> None:
        sim = self._sim
        sim.launch(update_midpoint, len(sim.u), sim.w, sim.u, dt, sim.state.x, sim.state.v, sim.diverged)

    def restart(self) -> None:
        """One step knows nothing of another."""
