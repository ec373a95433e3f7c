"""Point constraints bound to a device; the maths is in kernels/point.py."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.point import project_point
from pbd_warp.step.constraints.parameters import Parameters
from pbd_warp.step.context import Context, Stage


class Points:
    """The model's point constraints on its device; their targets are the context's. iterations: Of a step."""

    def __init__(self, context: Context, iterations: int):
        self._context = context
        points = context.model.point
        self.particle = context.upload("point.particle", points.particle, wp.int32)
        self.parameters = Parameters(context, "point", points.stiffness, points.compliance, iterations, context.vec3)

    def begin(self, stage: Stage) -> None:
        self.parameters.begin()

    def project(
        self,
        stage: Stage,
        u: wp.array,
        valence: wp.array | None,
        relaxation: float,
        residual: wp.array | None,
        correction: wp.array,
    ) -> None:
        """Line 10 for points."""
        p, context = self.parameters, self._context
        context.launch(
            project_point,
            len(self.particle),
            *(self.particle, context.point_target, p.stiffness, p.compliance),
            *(context.state.x, context.w),
            *(u, valence, relaxation, stage.compliance_scale, stage.mean_gradient),
            *(p.lam, residual, correction),
        )
