"""What the parts of a step are handed: the arrays of a model on its device, room for more, launches, the step's length.

It is built first and knows none of the parts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from pbd_warp.kernels import divergence
from pbd_warp.kernels.precision import PRECISIONS
from pbd_warp.model.model import Model, State
from pbd_warp.step.launch import Launcher

NOTHING = int(divergence.NOTHING)
"""In all places of `diverged` but the last: nothing to tell."""

NOTHING_TO_TELL = np.array([*[NOTHING] * 4, 0], np.int32)


@dataclass(frozen=True)
class Stage:
    """One pass of the paper's loop. Most integrators make one a step, compositions several.

    dt: Its length [s], negative where it goes back in time.
    compliance_scale: Warp array [1], 1 over what a force over mass is multiplied by on its way to the displacement
        [1/s^2]: compliance times it is alpha~ of XPBD.
    lam_scale: Takes multipliers of the stage before to this one's force scale.
    mean_gradient: Forces act along the mean of the configurations before and after, not along that after.
    """

    dt: float
    compliance_scale: wp.array
    lam_scale: float = 1.0
    mean_gradient: bool = False


class Context:
    """A model on its device, in its precision.

    Attributes:
        dt: Length of a step [s].
        drag: c of the force -c m v on what is free [1/s].
        depenetration_speed: What is wrong when a step begins is taken back no faster [m/s]; None: at once.
        launch: Launches kernels.
        state: Positions x [m] and velocities v [m/s].
        w: Inverse masses [1/kg], [particle_count]: the model's, but 0 for a grabbed particle.
        u: Displacement of the step [m], [particle_count].
        point_target: Of the point constraints [m], [point_count]; None where there are none.
        diverged: What a frame has found, int32 [5]: see kernels/divergence.py.
        arrays: All device arrays by name.
        fixed: Names of those that hold numbers of particles and the like, which never change.
    """

    def __init__(self, model: Model, dt: float, depenetration_speed: float | None = None, drag: float = 0.0):
        self.model = model
        self.dt = dt
        self.drag = drag
        self.depenetration_speed = depenetration_speed
        self.real, self.vec3 = model.real, PRECISIONS[model.real]["Vec3"]
        types = PRECISIONS[model.real]
        self.vec4, self.mat33, self.quat = types["Vec4"], types["Mat33"], types["Quat"]
        self.launch = Launcher(model.device, model.real)
        self.arrays: dict[str, wp.array] = {}
        self.fixed: set[str] = set()
        self.state = State(x=self.upload("x", model.x, self.vec3), v=self.upload("v", model.v, self.vec3))
        self.w = self.upload("w", model.w)
        self.u = self.allocate("u", model.particle_count, self.vec3)
        self.point_target = None
        if len(model.point):
            self.point_target = self.upload("point.target", model.point.target, self.vec3)
        self.diverged = self.upload("diverged", NOTHING_TO_TELL, wp.int32)
        self.gravity = self.vec3(*model.gravity)

    def forget_divergence(self) -> None:
        self.diverged.assign(NOTHING_TO_TELL)

    def upload(self, name: str, values: Any, dtype: Any = None) -> wp.array:
        """A device array, by default in the model's precision; `name` is what the cost sheet calls it."""
        self.arrays[name] = wp.array(np.asarray(values), dtype=dtype or self.real, device=self.model.device)
        if dtype in (wp.int32, wp.vec2i, wp.vec3i):
            self.fixed.add(name)
        return self.arrays[name]

    def allocate(self, name: str, shape: int, dtype: Any) -> wp.array:
        """A device array of zeros."""
        self.arrays[name] = wp.zeros(shape, dtype=dtype, device=self.model.device)
        return self.arrays[name]

    def put(self, x: np.ndarray, v: np.ndarray) -> None:
        """Positions [m] and velocities [m/s] as they were."""
        self.state.x.assign(x)
        self.state.v.assign(v)
