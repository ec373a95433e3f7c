"""A grabbed particle that is pulled: walls, contacts and lengths win. The maths is in kernels/pull.py.

The other way to hold one is exact (kinematic.py), and moves it through whatever is there.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.kernels.pull import pull
from pbd_warp.step.context import Context

RESPONSE = 1.0 / 60.0
"""T, at least [s]: what is left of the way to the target falls by 1/e in this time."""

RESPONSE_STEPS = 3.0
"""T, at least [steps]."""


class Pull:
    """Pulls one particle of a simulation; a fixed one has the mean mass of what it is joined to meanwhile.

    Args:
        dt: Length of a frame [s].
        acceleration: The force, over the mass of all that the particle is joined to, is at most this [m/s^2].
        speed: It follows no faster [m/s].
        fixed: Whether fixed particles can be pulled: `Direct` is built without them.

    Attributes:
        held: The grabbed particle, None for none.
        held_target: Where it is pulled to [m], float64 [3].
    """

    def __init__(self, context: Context, dt: float, acceleration: float, speed: float, fixed: bool):
        self._context = context
        self._takes_fixed = fixed
        self._dt, self._steps = dt, round(dt / context.dt)
        self._acceleration, self._speed = acceleration, speed
        self._particle = context.allocate("pull.particle", 1, wp.int32)  # not uploaded: it changes
        self._particle.fill_(-1)
        self._target = context.allocate("pull.target", 1, context.vec3)
        self._rate = context.allocate("pull.rate", 1, context.vec3)
        self._left = context.allocate("pull.left", 1, wp.int32)
        self._strength = context.allocate("pull.strength", 1, context.real)
        self._steady = context.allocate("pull.steady", 1, context.vec3)
        self.held: int | None = None
        self.held_target = np.zeros(3)

    def launch(self) -> None:
        """At the start of a step."""
        context = self._context
        response = max(RESPONSE, RESPONSE_STEPS * context.dt)
        context.launch(
            pull,
            1,
            *(context.state.x, context.w),
            *(self._particle, self._target, self._rate, self._strength, self._speed, response, context.dt),
            *(self._left, self._steady, context.state.v),
        )

    def grab(self, particle: int) -> None:
        """It is held where it is until it is moved or let go of; another one that is held is let go of."""
        context = self._context
        model = context.model
        check.indices("grab", [particle], model.particle_count)
        self._refuse_fixed(particle)
        self.release()
        one = slice(particle, particle + 1)
        mass = model.mass[model.component == model.component[particle]]
        mass = mass[mass > 0.0]
        if model.w[particle] == 0.0:
            context.w[one].fill_(1.0 / mass.mean() if mass.size else 1.0)
        self._strength.fill_(self._acceleration * (mass.sum() if mass.size else 1.0))
        self._steady.zero_()
        self._particle.fill_(particle)
        self.held = int(particle)
        self.held_target = context.state.x[one].numpy()[0].astype(np.float64)
        self._target.assign(context.state.x[one])
        self._left.zero_()

    def move_held(self, frame: int, position: ArrayLike) -> None:
        """Where the grabbed particle is pulled to [m], from now on; the target goes there evenly within a frame."""
        if self.held is None:
            raise InputError("move_to needs a grabbed particle: call grab(particle) first")
        before, self.held_target = self.held_target, check.vector("position", position)
        self._rate.assign(((self.held_target - before) / self._dt)[None].astype(self._context.model.dtype))
        self._left.fill_(self._steps)
        self._target.assign(self.held_target[None].astype(self._context.model.dtype))

    def release(self) -> None:
        """Let go. A free particle keeps its velocity; a fixed one stays where it is."""
        if self.held is None:
            return
        context = self._context
        one = slice(self.held, self.held + 1)
        if context.model.w[self.held] == 0.0:
            context.w[one].zero_()
            context.state.v[one].zero_()
        self._particle.fill_(-1)
        self.held = None

    @property
    def memory(self) -> dict[str, Any]:
        """Everything that is not on the device, as values that JSON can hold."""
        return {"held": self.held, "held_target": self.held_target.tolist()}

    def checked(self, memory: Any) -> None:
        """Raise an InputError for what `memory` would not have said of this model."""
        if not isinstance(memory, dict) or memory.keys() != {"held", "held_target"}:
            raise InputError("the checkpoint does not say rightly what is pulled")
        check.vector("held_target", memory["held_target"])
        if memory["held"] is not None:
            check.indices("held", [memory["held"]], self._context.model.particle_count)

    def restore(self, memory: dict[str, Any]) -> None:
        """Go on from the `memory` of another; what is on the device comes with its arrays."""
        self.held = memory["held"]
        self.held_target = np.array(memory["held_target"], np.float64)

    def take_over(self, other: Pull) -> None:
        """Go on from where another of the same model is, with the strength and speed of this one."""
        if other.held is not None:
            self._refuse_fixed(other.held)
        for name in ("_particle", "_target", "_rate", "_steady"):
            wp.copy(getattr(self, name), getattr(other, name))
        # What is left of the frame that was asked for, in steps of this one.
        self._left.fill_(int(other._left.numpy()[0]) * self._steps // other._steps)
        ratio = self._acceleration / other._acceleration
        self._strength.assign(other._strength.numpy() * ratio)
        self.restore(other.memory)

    def _refuse_fixed(self, particle: int) -> None:
        if not self._takes_fixed and self._context.model.w[particle] == 0.0:
            raise InputError(
                f"particle {particle} is fixed, and method 'direct' takes no fixed particle that is pulled: grab it "
                "exactly (grab_acceleration None), or use Jacobi or GaussSeidel"
            )
