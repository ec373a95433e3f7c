"""dampVelocities (line 6) bound to a device; the maths is in kernels/damping.py."""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels.damping import (
    damp_velocities,
    divide_by_mass,
    find_rotation,
    sum_angular_momentum,
    sum_momentum,
)
from pbd_warp.kernels.integrate import accelerate
from pbd_warp.step.context import Context, Stage

EIGENVALUE_CUTOFF = 16.0
"""An inertia below this many machine epsilons of the largest is that of a straight line seen through rounding."""


class Damper:
    """Takes away the fraction `damping` of the velocities that are not rigid motion in so many `steps`.

    Each of them takes 1 - (1 - damping)^(1 / steps), so the rate does not depend on their number.
    """

    def __init__(self, context: Context, damping: float, steps: int):
        self._context = context
        model = context.model
        _, first = np.unique(model.component, return_index=True)
        self.component = context.upload("damping.component", model.component, wp.int32)
        self.first = context.upload("damping.first", first, wp.int32)
        n = len(first)
        self.mass = context.allocate("damping.mass", n, context.real)
        # First the moment and the momentum, then both over the mass.
        self.centre = context.allocate("damping.centre", n, context.vec3)
        self.velocity = context.allocate("damping.velocity", n, context.vec3)
        self.angular_momentum = context.allocate("damping.angular_momentum", n, context.vec3)
        self.inertia = context.allocate("damping.inertia", n, context.mat33)
        self.omega = context.allocate("damping.omega", n, context.vec3)
        self.fraction = 1.0 - (1.0 - damping) ** (1.0 / steps)
        self.cutoff = EIGENVALUE_CUTOFF * float(np.finfo(model.dtype).eps)

    def accelerate_and_damp(self, stage: Stage) -> None:
        """Lines 5 and 6. Line 5 is otherwise part of the prediction; here line 6 needs its result first."""
        context = self._context
        launch = context.launch
        x, v, w = context.state.x, context.state.v, context.w
        launch(accelerate, len(x), context.gravity, w, stage.dt, v)
        graph = (self.component, self.first)
        means = (self.centre, self.velocity)
        for array in (self.mass, *means, self.angular_momentum, self.inertia):
            launch.zero(array)
        launch(sum_momentum, len(x), *graph, x, v, w, self.mass, *means)
        launch(divide_by_mass, len(self.first), self.mass, *means)
        launch(sum_angular_momentum, len(x), *graph, x, v, w, *means, self.angular_momentum, self.inertia)
        launch(find_rotation, len(self.first), self.angular_momentum, self.inertia, self.cutoff, self.omega)
        launch(damp_velocities, len(x), *graph, x, w, *means, self.omega, self.fraction, v)
