"""Bending bound to a device for sweeps; the maths is in kernels/bending.py."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.bending import project_bending
from pbd_warp.model.bending import BendingSet
from pbd_warp.step.context import Context, Stage


class Bends:
    """Triples that resist bending, on a device, in its precision."""

    def __init__(self, context: Context, constraints: BendingSet, name: str = "bending"):
        self._context = context
        self.triple = context.upload(f"{name}.triple", constraints.triple, wp.vec3i)
        self.compliance = context.upload(f"{name}.compliance", constraints.length / constraints.stiffness)
        self.length = context.upload(f"{name}.length", constraints.length)
        self.rest = context.upload(f"{name}.rest", constraints.rest)
        self.lam = context.allocate(f"{name}.lam", len(constraints), context.vec3)

    def begin(self, stage: Stage) -> None:
        self._context.launch.zero(self.lam)

    def project(
        self,
        stage: Stage,
        u: wp.array,
        valence: wp.array | None,
        relaxation: float,
        residual: wp.array | None,
        correction: wp.array,
    ) -> None:
        """Line 10 for bending."""
        context = self._context
        context.launch(
            project_bending,
            len(self.triple),
            *(self.triple, self.compliance, self.length, self.rest),
            *(context.state.x, context.w),
            *(u, valence, relaxation, stage.compliance_scale, stage.mean_gradient),
            *(self.lam, residual, correction),
        )
