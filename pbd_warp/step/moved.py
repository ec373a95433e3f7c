"""What is moved from outside: fixed particles that are led, one that is grabbed (exactly or by a pull), colliders."""

from __future__ import annotations

from typing import Any

import numpy as np

from pbd_warp.errors import InputError
from pbd_warp.step.colliders import ColliderShapes
from pbd_warp.step.context import Context
from pbd_warp.step.kinematic import KinematicParticles
from pbd_warp.step.moved_colliders import MovedColliders
from pbd_warp.step.pull import Pull


class Moved:
    """Of one simulation.

    Args:
        dt: Length of a frame [s].
        pull: What holds the grabbed particle; None: it is held exactly.
        shapes: Its colliders; None where nothing collides.
    """

    def __init__(self, context: Context, dt: float, pull: Pull | None, shapes: ColliderShapes | None):
        self._context = context
        self._colliders = MovedColliders(context, shapes, dt)
        self._kinematic = KinematicParticles(context, dt)
        self._pull = pull
        self._grip: KinematicParticles | Pull = pull or self._kinematic
        self.grab, self.move_held, self.release = self._grip.grab, self._grip.move_held, self._grip.release
        self.move_fixed, self.move_collider = self._kinematic.move_fixed, self._colliders.move
        self.put_colliders = self._colliders.put

    def begin_frame(self, frame: int) -> bool:
        """What is not moved in this frame rests; whether anything is moved."""
        particles, colliders = self._kinematic.begin_frame(frame), self._colliders.begin_frame(frame)
        return particles or colliders

    @property
    def held(self) -> int | None:
        """The grabbed particle, None for none."""
        return self._grip.held

    @property
    def held_target(self) -> np.ndarray | None:
        """Where it is moved to [m], float64 [3]; None without one."""
        return None if self.held is None else self._grip.held_target.copy()

    def where_held(self, x: np.ndarray) -> None:
        """Put into positions [m], [particle_count, 3], where a particle that is held exactly is led to."""
        if self._kinematic.held is not None:
            x[self._kinematic.held] = self._kinematic.held_target

    def reset(self) -> None:
        """Nothing is held or moves."""
        self.release()
        self._kinematic.reset()
        self._colliders.reset()

    @property
    def memory(self) -> dict[str, Any]:
        """Everything that is not on the device, as values that JSON can hold."""
        colliders = self._colliders.memory
        return {"kinematic": self._kinematic.memory, "pull": self._pull and self._pull.memory, "colliders": colliders}

    def checked(self, memory: Any) -> dict[str, Any]:
        """A `memory` from a file.

        Raises:
            InputError: what `memory` would not have said of this model.
        """
        if not isinstance(memory, dict) or memory.keys() != {"kinematic", "pull", "colliders"}:
            raise InputError("the checkpoint does not say rightly which particles are held or led")
        self._kinematic.checked(memory["kinematic"])
        self._colliders.checked(memory["colliders"])
        if self._pull:
            self._pull.checked(memory["pull"])
        return memory

    def restore(self, memory: dict[str, Any]) -> None:
        """Go on from the `memory` of another; what is on the device comes with its arrays."""
        self._kinematic.restore(memory["kinematic"])
        self._colliders.restore(memory["colliders"])
        if self._pull:
            self._pull.restore(memory["pull"])

    def take_over(self, other: Moved, start: bool) -> None:
        """Go on from where another of the same model is, whose velocities and inverse masses are here already; with
        colliders as at the `start` of its frame."""
        self._kinematic.restore(other._kinematic.memory)
        self._colliders.take_over(other._colliders, start)
        if self._pull and other._pull:
            self._pull.take_over(other._pull)
        elif (self._pull or other._pull) and other.held is not None:
            particle, target = other.held, other._grip.held_target
            self._kinematic.held = None
            self._context.w[particle : particle + 1].fill_(self._context.model.w[particle])
            self._grip.grab(particle)
            if self._pull:
                self._pull.move_held(0, target)  # held exactly it would jump there
