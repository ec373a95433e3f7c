"""The paper's integrator: semi-implicit prediction, velocity from the displacement. First order, dissipative."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pbd_warp.kernels.integrate import accelerate, predict, update

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


class PBD:
    """v += dt g, p = x + dt v; then v = u / dt, x += u with u = p - x.

    Source: Mueller et al. 2007, section 3.1, lines 5, 7 and 12-15.
    """

    name = "pbd"
    order = 1

    def __init__(self, sim: Simulation):
        self._sim = sim
        self._gravity = sim.vec3(*sim.model.gravity)

    def accelerate(self) -> None:
        """Line 5 by itself, for a step whose line 6 needs its result; `predict` does it otherwise."""
        sim = self._sim
        sim.launch(accelerate, len(sim.u), self._gravity, sim.w, sim.substep_dt, sim.state.v)

    def predict(self, remaining: int) -> None:
        """Lines 5 and 7. `remaining`: substeps left in the frame, this one included."""
        sim = self._sim
        gravity = sim.vec3() if sim.damper else self._gravity
        sim.launch(
            predict,
            len(sim.u),
            *(gravity, sim.state.x, sim.w, sim.substep_dt),
            *(sim.grabbed, sim.grab_target, float(remaining)),
            *(sim.state.v, sim.u),
        )

    def update(self) -> None:
        """Lines 12-15."""
        sim = self._sim
        sim.launch(update, len(sim.u), sim.u, sim.substep_dt, sim.state.x, sim.state.v, sim.diverged)
