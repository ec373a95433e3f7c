"""Kinematic particles: what moves as it is told, whatever pulls at it. The maths is in kernels/kinematic.py.

There is one mechanism. A kinematic particle has the inverse mass 0, and in each frame the velocity that takes it to
its target by the frame's end. Fixed particles are always so; a free one is while it is grabbed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.kernels.kinematic import move_to_targets, stop
from pbd_warp.step.context import Context


class KinematicParticles:
    """Moves particles of one simulation.

    Args:
        dt: Length of a frame [s].

    Attributes:
        held: The grabbed particle, None for none.
        held_target: Where it is led to [m], float64 [3]; where it was grabbed until it is moved.
    """

    def __init__(self, context: Context, dt: float):
        self._context = context
        self._dt = dt
        self.held: int | None = None
        self.held_target = np.zeros(3)
        self._held_path = _Moves(context)
        self._fixed_path = _Moves(context)

    def grab(self, particle: int) -> None:
        """It stays where it is until it is moved or let go of; another one that is held is let go of."""
        context = self._context
        check.indices("grab", [particle], context.model.particle_count)
        self.release()
        one = slice(particle, particle + 1)
        context.w[one].zero_()
        context.state.v[one].zero_()
        # A copy: on the CPU what comes from the device is the live state itself.
        self.held_target = context.state.x[one].numpy()[0].astype(np.float64)
        self.held = int(particle)

    def move_held(self, frame: int, position: ArrayLike) -> None:
        """Where the grabbed particle is at the end of a frame [m]."""
        if self.held is None:
            raise InputError("move_to needs a grabbed particle: call grab(particle) first")
        self.held_target = check.vector("position", position)
        self._held_path.begin(frame, np.array([self.held]), self.held_target[None], self._dt)

    def release(self) -> None:
        """Let go. A free particle keeps the velocity that it was moved with; a fixed one stays where it is."""
        if self.held is None:
            return
        context = self._context
        one = slice(self.held, self.held + 1)
        w = float(context.model.w[self.held])
        context.w[one].fill_(w)
        if w == 0.0:
            context.state.v[one].zero_()
        self._held_path.forget()
        self.held = None

    def move_fixed(self, frame: int, particles: ArrayLike, positions: ArrayLike) -> None:
        """Where fixed particles, int [n], are at the end of a frame [m], [n, 3]; others that were moving rest."""
        model = self._context.model
        index = np.atleast_1d(check.indices("lead", particles, model.particle_count))
        target = check.vectors("positions", positions)
        if len(target) != len(index):
            raise InputError(f"lead needs a position for each of {len(index)} particles, not {len(target)}")
        free = index[model.w[index] > 0.0]
        if free.size:
            raise InputError(f"lead takes fixed particles, but particle {free[0]} has mass: fix it (mass 0) or grab it")
        self._fixed_path.stop()
        self._fixed_path.begin(frame, index, target, self._dt)

    def begin_frame(self, frame: int) -> bool:
        """What is not moved in this frame rests; whether anything is moved."""
        paths = (self._held_path, self._fixed_path)
        for path in paths:
            if path.frame != frame:
                path.stop()
        return any(path.frame == frame for path in paths)

    def reset(self) -> None:
        """Nothing is held or moves."""
        self.release()
        self._held_path.forget()
        self._fixed_path.forget()

    @property
    def memory(self) -> dict[str, Any]:
        """Everything that is not on the device, as values that JSON can hold."""
        paths = [[path.frame, path.particles.tolist()] for path in (self._held_path, self._fixed_path)]
        return {"held": self.held, "held_target": self.held_target.tolist(), "paths": paths}

    def checked(self, memory: Any) -> dict[str, Any]:
        """A `memory` from a file.

        Raises:
            InputError: what `memory` would not have said of this model.
        """
        count = self._context.model.particle_count
        try:
            held, target, paths = memory["held"], memory["held_target"], memory["paths"]
            check.vector("held_target", target)
            for particles in ([] if held is None else [held], *(particles for _, particles in paths)):
                check.indices("particles", particles, count)
            for frame, _ in paths:
                if frame is not None:
                    check.whole("frame", frame, low=0)
            fits = len(paths) == 2 and (held is None or isinstance(held, int))
        except (KeyError, TypeError, ValueError, OverflowError):
            fits = False
        if not fits:
            raise InputError("the checkpoint does not say rightly which particles are held or led")
        return memory

    def restore(self, memory: dict[str, Any]) -> None:
        """Go on from the `memory` of another; velocities and inverse masses come with the device's arrays."""
        self.held = memory["held"]
        self.held_target = np.array(memory["held_target"], np.float64)
        for path, (frame, particles) in zip((self._held_path, self._fixed_path), memory["paths"], strict=True):
            path.frame, path.particles = frame, np.array(particles, np.int32)


class _Moves:
    """Particles that move in one frame: `frame` is its number, None for none."""

    def __init__(self, context: Context):
        self._context = context
        self.frame: int | None = None
        self.particles = np.zeros(0, np.int32)
        self._on_device: tuple[np.ndarray, wp.array, wp.array] | None = None

    def begin(self, frame: int, particles: np.ndarray, positions: np.ndarray, dt: float) -> None:
        context = self._context
        self.frame, self.particles = frame, particles
        index, target = self._arrays()
        target.assign(positions.astype(context.model.dtype))
        context.launch(move_to_targets, len(particles), context.state.x, index, target, dt, context.state.v)

    def stop(self) -> None:
        if self.frame is not None:
            context = self._context
            context.launch(stop, len(self.particles), self._arrays()[0], context.state.v)
            self.forget()

    def forget(self) -> None:
        self.frame = None

    def _arrays(self) -> tuple[wp.array, wp.array]:
        """The indices and room for targets, kept from frame to frame: mostly it is the same particles that move."""
        if self._on_device is None or not np.array_equal(self._on_device[0], self.particles):
            device = self._context.model.device
            index = wp.array(self.particles, dtype=wp.int32, device=device)
            target = wp.zeros(len(self.particles), dtype=self._context.vec3, device=device)
            self._on_device = self.particles, index, target
        return self._on_device[1], self._on_device[2]
