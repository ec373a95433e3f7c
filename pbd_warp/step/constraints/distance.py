"""Distance constraints bound to a device; the maths is in kernels/distance.py."""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels.distance import limit_lengths, project_distance
from pbd_warp.model.constraints import DistanceSet
from pbd_warp.step.constraints.parameters import Parameters
from pbd_warp.step.context import Context, Stage


class Distances:
    """Distance constraints on a device, in its precision. iterations: Of a step, which stiffness is spread over."""

    def __init__(self, context: Context, constraints: DistanceSet, iterations: int, name: str = "distance"):
        self._context = context
        self.edge = context.upload(f"{name}.edge", constraints.edge, wp.vec2i)
        rest_length = context.upload(f"{name}.rest_length", constraints.rest_length)
        self.parameters = Parameters(
            context, name, constraints.stiffness, constraints.compliance, iterations, context.real
        )
        compliant = (constraints.compliance > 0.0) | (constraints.stiffness < 1.0)
        self.lengths = LimitedLengths(context, name, self.edge, rest_length, compliant)

    def begin(self, stage: Stage) -> None:
        self.parameters.begin()
        self.lengths.begin(stage)

    def project(
        self,
        stage: Stage,
        u: wp.array,
        valence: wp.array | None,
        relaxation: float,
        residual: wp.array | None,
        correction: wp.array,
    ) -> None:
        """Line 10 for distances."""
        p, context = self.parameters, self._context
        context.launch(
            project_distance,
            len(self.edge),
            *(self.edge, self.lengths.now, p.stiffness, p.compliance),
            *(context.state.x, context.w),
            *(u, valence, relaxation, stage.compliance_scale, stage.mean_gradient),
            *(p.lam, residual, correction),
        )


class LimitedLengths:
    """The lengths that a step asks for, `now`: the rest lengths, or, with a depenetration speed, as far towards them as
    that allows. Not of compliant distances, bool [edge_count]: what they are off is their force."""

    def __init__(self, context: Context, name: str, edge: wp.array, rest_length: wp.array, compliant: np.ndarray):
        self._context = context
        self._edge, self._rest_length = edge, rest_length
        self.now = rest_length
        if context.depenetration_speed is not None:
            self._compliant = context.upload(f"{name}.compliant", compliant, wp.int32)
            self.now = context.allocate(f"{name}.length_now", len(edge), context.real)

    def begin(self, stage: Stage) -> None:
        context = self._context
        if context.depenetration_speed is not None:
            depenetration = context.depenetration_speed * abs(stage.dt)
            context.launch(
                limit_lengths,
                len(self._edge),
                *(self._edge, self._rest_length, self._compliant, context.state.x, depenetration, self.now),
            )
