"""The paper's integrator: semi-implicit prediction, velocity from the displacement. First order, dissipative."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from pbd_warp.kernels.integrate import predict, update

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


class PBD:
    """v += dt g, p = x + dt v; then v = u / dt, x += u with u = p - x.

    Source: Mueller et al. 2007, section 3.1, lines 5, 7 and 12-15. As robust as it gets; order 1, and energy is lost:
    a free dumbbell at one turn a second and 60 steps a second loses 64 % of its spin in 5 s.
    """

    order = 1
    stages: tuple[float, ...] = (1.0,)
    mean_gradient = False

    def __init__(self, sim: Simulation):
        self._sim = sim
        self._gravity = sim.vec3(*sim.model.gravity)
        self._per_force = sim.upload("per_force", [1.0 / sim.substep_dt**2])

    def per_force(self, stage: int) -> wp.array:
        """1 over what a force over mass is multiplied by on its way to the displacement, [1] on the device [1/s^2]."""
        return self._per_force

    def predict(self, dt: float, part: float) -> None:
        """Lines 5 and 7. `part`: of the way to its target that the grabbed particle goes in this step."""
        sim = self._sim
        gravity = sim.vec3() if sim.damper else self._gravity  # which damping has added already
        sim.launch(
            predict,
            len(sim.u),
            *(gravity, sim.state.x, sim.w, dt),
            *(sim.grabbed, sim.grab_target, part),
            *(sim.state.v, sim.u),
        )

    def update(self, dt: float) -> None:
        """Lines 12-15."""
        sim = self._sim
        sim.launch(update, len(sim.u), sim.u, dt, sim.state.x, sim.state.v, sim.diverged)

    def restart(self) -> None:
        """Forget what came before; called when a particle is taken or let go of. There is nothing to forget."""
