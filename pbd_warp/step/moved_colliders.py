"""Colliders that are moved from outside: as kinematic particles, each has the velocity that takes it to its target by
the frame's end, and a spin. The maths is in kernels/shape_contact.py."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.kernels.shape_contact import aim_shapes
from pbd_warp.model.rotation import after, quaternion
from pbd_warp.step.colliders import ColliderShapes
from pbd_warp.step.context import Context


class MovedColliders:
    """Of one simulation.

    Args:
        shapes: None where nothing collides.
        dt: Length of a frame [s].
    """

    def __init__(self, context: Context, shapes: ColliderShapes | None, dt: float):
        self._context, self._shapes, self._dt = context, shapes, dt
        self._moved: dict[int, int] = {}  # the frame in which each collider is moved

    def move(self, frame: int, which: int, position: ArrayLike, rotation: ArrayLike) -> None:
        """Where a collider's frame is at the end of a frame [m], and how it is turned then from how it was added
        (axis times angle [rad]); it gets there evenly, the shorter way round."""
        context, model = self._context, self._context.model
        check.index("collider", which, len(model.colliders))
        place = check.vector("position", position)
        turn = quaternion(check.vector("rotation", rotation))
        if self._shapes is None or not model.colliders.moves[which]:
            raise InputError(f"{model.colliders.name(which)} does not move: let it with ModelBuilder.let_collider_move")
        device, shapes = model.device, self._shapes
        context.launch(
            aim_shapes,
            1,
            wp.array([int(np.flatnonzero(shapes.shapes == which)[0])], dtype=wp.int32, device=device),
            wp.array(place[None].astype(model.dtype), dtype=context.vec3, device=device),
            wp.array(after(turn, model.colliders.rotation[which])[None], dtype=context.quat, device=device),
            *(self._dt, shapes.centre, shapes.rotation, shapes.velocity, shapes.spin),
        )
        self._moved[which] = frame

    def begin_frame(self, frame: int) -> bool:
        """What was moved and is not in this frame rests; whether anything is moved."""
        for which in [which for which, when in self._moved.items() if when != frame]:
            assert self._shapes
            self._shapes.stop(which)
            del self._moved[which]
        return bool(self._moved)

    def reset(self) -> None:
        self._moved.clear()
        if self._shapes:
            self._shapes.reset()

    def put(self, motion: np.ndarray) -> None:
        """To what `ColliderShapes.motion` was."""
        if self._shapes:
            self._shapes.put(motion)

    def take_over(self, other: MovedColliders, start: bool) -> None:
        """Go on from where another of the same model is, or, at the `start` of a frame, was."""
        self._moved = dict(other._moved)
        if self._shapes and other._shapes:
            self._shapes.take_over(other._shapes, start)

    @property
    def memory(self) -> Any:
        """What is not on the device, as values that JSON can hold."""
        return sorted(self._moved.items())

    def checked(self, memory: Any) -> Any:
        """A `memory` from a file.

        Raises:
            InputError: what `memory` would not have said of this model.
        """
        moves = self._context.model.colliders.moves
        try:
            rows = [
                (check.index("collider", which, len(moves)), check.whole("frame", at, low=0)) for which, at in memory
            ]
        except (TypeError, ValueError):
            raise InputError("the checkpoint does not say rightly which colliders are moved") from None
        if any(not moves[which] for which, _ in rows):
            raise InputError("the checkpoint moves a collider that does not move")
        return memory

    def restore(self, memory: Any) -> None:
        """Go on from the `memory` of another; what is on the device comes with its arrays."""
        self._moved = dict(memory)
