"""Backward differentiation: second order, dissipative, as robust as "pbd"."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from pbd_warp.kernels.bdf2 import predict_bdf2, remember, update_bdf2
from pbd_warp.step.integrators.second_order import refuse_first_order_features

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


class BDF2:
    """p = (4 x_n - x_{n-1})/3 + (2 dt/3)(4 v_n - v_{n-1})/3 + (4 dt^2/9) a, v = (3 x_{n+1} - 4 x_n + x_{n-1})/(2 dt).

    Source: kernels/bdf2.py. The first step, and the one after a particle is taken or let go of, is "pbd"; a single step
    of first order does not cost the order. It still loses energy, by the third power of the step.
    """

    order = 2
    stages: tuple[float, ...] = (1.0,)
    mean_gradient = False

    def __init__(self, sim: Simulation):
        refuse_first_order_features("bdf2", sim)
        self._sim = sim
        self._gravity = sim.vec3(*sim.model.gravity)
        n = sim.model.particle_count
        self._history = sim.allocate("bdf2.history", 1, wp.int32)
        self._u_before = sim.allocate("bdf2.u_before", n, sim.vec3)
        self._v_before = sim.allocate("bdf2.v_before", n, sim.vec3)
        self._first_per_force = 1.0 / sim.substep_dt**2
        self._per_force = sim.upload("per_force", [self._first_per_force])

    def per_force(self, stage: int) -> wp.array:
        """1 / dt^2 in the first step, 9 / (4 dt^2) after it."""
        return self._per_force

    def predict(self, dt: float, part: float) -> None:
        sim = self._sim
        sim.launch(
            predict_bdf2,
            len(sim.u),
            *(self._gravity, sim.state.x, sim.state.v, sim.w, dt),
            *(sim.grabbed, sim.grab_target, part, self._history, self._u_before, self._v_before),
            sim.u,
        )

    def update(self, dt: float) -> None:
        sim = self._sim
        sim.launch(
            update_bdf2,
            len(sim.u),
            *(sim.w, sim.u, dt, self._history),
            *(self._u_before, self._v_before, sim.state.x, sim.state.v, sim.diverged),
        )
        sim.launch(remember, 1, 9.0 / 4.0 * self._first_per_force, self._history, self._per_force)

    def restart(self) -> None:
        self._history.zero_()
        self._per_force.fill_(self._first_per_force)
