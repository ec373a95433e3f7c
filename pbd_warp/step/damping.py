"""dampVelocities (line 6) bound to a simulation; the maths is in kernels/damping.py."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from pbd_warp.kernels.damping import damp_velocities, find_rotation, sum_angular_momentum, sum_momentum
from pbd_warp.kernels.integrate import accelerate
from pbd_warp.kernels.precision import PRECISIONS

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation

EIGENVALUE_CUTOFF = 16.0
"""An inertia below this many machine epsilons of the largest is that of a straight line seen through rounding."""


class Damper:
    """Takes away the fraction `damping` of the velocities that are not rigid motion, once a frame's worth.

    Each of the substeps takes 1 - (1 - damping)^(1 / substeps), so the rate does not depend on their number.
    """

    def __init__(self, sim: Simulation):
        self._sim = sim
        model = sim.model
        self._gravity = sim.vec3(*model.gravity)
        _, first = np.unique(model.component, return_index=True)
        mat33 = PRECISIONS[sim.real]["Mat33"]
        self.component = sim.upload("damping.component", model.component, wp.int32)
        self.first = sim.upload("damping.first", first, wp.int32)
        n = len(first)
        self.mass = sim.allocate("damping.mass", n, sim.real)
        self.moment = sim.allocate("damping.moment", n, sim.vec3)
        self.momentum = sim.allocate("damping.momentum", n, sim.vec3)
        self.angular_momentum = sim.allocate("damping.angular_momentum", n, sim.vec3)
        self.inertia = sim.allocate("damping.inertia", n, mat33)
        self.omega = sim.allocate("damping.omega", n, sim.vec3)
        self.fraction = 1.0 - (1.0 - sim.damping) ** (1.0 / sim.substeps)
        self.cutoff = EIGENVALUE_CUTOFF * float(np.finfo(model.dtype).eps)

    def accelerate_and_damp(self, dt: float) -> None:
        """Lines 5 and 6. Line 5 is otherwise part of the prediction; here line 6 needs its result first."""
        sim = self._sim
        launch = sim.launch
        x, v, w = sim.state.x, sim.state.v, sim.w
        launch(accelerate, len(x), self._gravity, w, dt, v)
        graph = (self.component, self.first)
        sums = (self.mass, self.moment, self.momentum)
        for array in (*sums, self.angular_momentum, self.inertia):
            launch.zero(array)
        launch(sum_momentum, len(x), *graph, x, v, w, *sums)
        launch(sum_angular_momentum, len(x), *graph, x, v, w, *sums, self.angular_momentum, self.inertia)
        launch(find_rotation, len(self.first), self.angular_momentum, self.inertia, self.cutoff, self.omega)
        launch(damp_velocities, len(x), *graph, x, w, *sums, self.omega, self.fraction, v)
