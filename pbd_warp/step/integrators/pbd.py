"""The paper's integrator: semi-implicit prediction, velocity from the displacement. First order, dissipative."""

from __future__ import annotations

from pbd_warp.kernels.integrate import predict, update
from pbd_warp.step.context import Context, Stage


class PBD:
    """v += dt g, p = x + dt v; then v = u / dt, x += u with u = p - x.

    Source: Mueller et al. 2007, section 3.1, lines 5, 7 and 12-15. As robust as it gets; order 1, and energy is lost:
    a free dumbbell at one turn a second and 60 steps a second loses 64 % of its spin in 5 s.

    damped: Line 5 is run with line 6, before the prediction.
    """

    order = 1
    mean_gradient = False

    def __init__(self, context: Context, damped: bool = False):
        self._context = context
        self._gravity = context.vec3() if damped else context.gravity
        slowed = 1.0 + context.drag * context.dt
        self._keep = 1.0 / slowed
        self.stages = [Stage(context.dt, context.upload("compliance_scale", [slowed / context.dt**2]))]

    def predict(self, stage: Stage) -> None:
        """Lines 5 and 7."""
        context = self._context
        v, u = context.state.v, context.u
        context.launch(predict, len(u), self._gravity, context.w, stage.dt, self._keep, v, u)

    def update(self, stage: Stage) -> None:
        """Lines 12-15."""
        context = self._context
        context.launch(update, len(context.u), context.u, stage.dt, context.state.x, context.state.v, context.diverged)

    def restart(self) -> None:
        """Forget what came before; called when a particle is grabbed or let go of. There is nothing to forget."""
