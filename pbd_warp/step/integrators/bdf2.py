"""Backward differentiation: second order, dissipative, as robust as "pbd"."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.bdf2 import predict_bdf2, remember, update_bdf2
from pbd_warp.step.context import Context, Stage


class BDF2:
    """p = (4 x_n - x_{n-1})/3 + (2 dt/3)(4 v_n - v_{n-1})/3 + (4 dt^2/9) a, v = (3 x_{n+1} - 4 x_n + x_{n-1})/(2 dt).

    Source: kernels/bdf2.py. The first step, and the one after a particle is grabbed or let go of, is "pbd"; a single
    step of first order does not cost the order. It still loses energy, by the third power of the step.
    """

    order = 2
    mean_gradient = False

    def __init__(self, context: Context, damped: bool = False):
        self._context = context
        count = context.model.particle_count
        self._history = context.allocate("bdf2.history", 1, wp.int32)
        self._u_before = context.allocate("bdf2.u_before", count, context.vec3)
        self._v_before = context.allocate("bdf2.v_before", count, context.vec3)
        # 1 / dt^2 in the first step, 9 / (4 dt^2) after it; but for drag.
        slow = context.drag * context.dt
        self._first_scale = (1.0 + slow) / context.dt**2
        self._later_scale = 9.0 / 4.0 * ((1.0 + 2.0 / 3.0 * slow) / context.dt**2)
        self._scale = context.upload("compliance_scale", [self._first_scale])
        self.stages = [Stage(context.dt, self._scale)]

    def predict(self, stage: Stage) -> None:
        """Lines 5 and 7."""
        context = self._context
        context.launch(
            predict_bdf2,
            len(context.u),
            *(context.gravity, context.state.v, context.w, stage.dt, context.drag),
            *(self._history, self._u_before, self._v_before, context.u),
        )

    def update(self, stage: Stage) -> None:
        """Lines 12-15."""
        context = self._context
        context.launch(
            update_bdf2,
            len(context.u),
            *(context.w, context.u, stage.dt, self._history),
            *(self._u_before, self._v_before, context.state.x, context.state.v, context.diverged),
        )
        context.launch(remember, 1, self._later_scale, self._history, self._scale)

    def restart(self) -> None:
        """The next step is the first."""
        self._history.zero_()
        self._scale.fill_(self._first_scale)
