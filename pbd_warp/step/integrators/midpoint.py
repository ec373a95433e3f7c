"""Implicit midpoint: second order, keeps energy and angular momentum."""

from __future__ import annotations

from pbd_warp.errors import InputError
from pbd_warp.kernels.midpoint import predict_midpoint, update_midpoint
from pbd_warp.step.context import Context, Stage


class Midpoint:
    """p = x + dt v + dt^2/2 a, forces along the gradient of the mean configuration, v = 2 u / dt - v.

    Source: kernels/midpoint.py. With `Direct` energy and angular momentum are kept to round-off, for every step that it
    converges in. Nothing is damped: what a step too long for a whip puts into the fast modes stays there.
    """

    order = 2
    mean_gradient = True
    composition: tuple[float, ...] = (1.0,)
    """Lengths of the stages, relative to the step."""

    def __init__(self, context: Context, damped: bool = False):
        self._context = context
        before = (*self.composition[-1:], *self.composition)  # the first stage comes after the last of one step ago
        slowed = [1.0 + 0.5 * context.drag * length * context.dt for length in self.composition]
        if min(slowed) < 0.5:
            raise InputError(
                f"a drag of {context.drag:g} 1/s is too much for a step of {context.dt:.3g} s, part of which goes back "
                "in time: use shorter steps, or integrator 'midpoint'"
            )
        self._keep = {length * context.dt: 1.0 / slow for length, slow in zip(self.composition, slowed, strict=True)}
        self.stages = [
            Stage(
                dt=length * context.dt,
                compliance_scale=context.upload(
                    f"compliance_scale.{number}", [slowed[number] * (2.0 / (length * context.dt) ** 2)]
                ),
                lam_scale=(length / before[number]) ** 2,
                mean_gradient=True,
            )
            for number, length in enumerate(self.composition)
        ]

    def predict(self, stage: Stage) -> None:
        """Lines 5 and 7."""
        context = self._context
        context.launch(
            predict_midpoint,
            len(context.u),
            *(context.gravity, context.state.v, context.w, stage.dt, self._keep[stage.dt], context.u),
        )

    def update(self, stage: Stage) -> None:
        """Lines 12-15."""
        context = self._context
        context.launch(
            update_midpoint,
            len(context.u),
            *(context.w, context.u, stage.dt, context.state.x, context.state.v, context.diverged),
        )

    def restart(self) -> None:
        """One step knows nothing of another."""
