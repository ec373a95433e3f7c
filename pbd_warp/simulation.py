"""A model in motion, frame by frame, and everything that one does with it; readings.py is what one reads off it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from pbd_warp import check, retry
from pbd_warp.built import BuiltForSettings
from pbd_warp.checkpoint import Checkpoint
from pbd_warp.errors import SimulationFailed
from pbd_warp.failure import Failure, failed, failed_copies
from pbd_warp.loop import Loop
from pbd_warp.model.builder import ModelBuilder
from pbd_warp.model.model import Model, State
from pbd_warp.player.playable import Playable
from pbd_warp.preflight import PreflightWarning, Snapshot, preflight
from pbd_warp.readings import Readings
from pbd_warp.settings import Settings
from pbd_warp.step.launch import not_while_recording
from pbd_warp.step.moved import Moved


@not_while_recording(
    "__init__", "reset", "restore", "continue_with", "grab", "move_to", "release", "lead", "move_collider", "_retry"
)
class Simulation(BuiltForSettings, Readings, Playable):
    """Runs a model, frame by frame.

    Args:
        model: What to simulate; a builder is finalized with its defaults.
        settings: How; the defaults of `Settings` unless given.
        **changes: Settings by name that take the place of those: dt, substeps, method, integrator, damping, ...

    Attributes:
        model: The model, with the gravity and stiffness of the settings.
        settings: A frozen `Settings`; `like` and `continue_with` make a simulation with others.
        state: Positions and velocities now; Warp arrays, which may be read and written between frames.
        frame: Frames done.
        failures: Of a replicated model: the sentence on each copy that has diverged, by its number; the others go on.
        retried: Frames that "subdivide" or "fallback" made again with success.

    Raises:
        InputError: a setting that makes no sense, or that method or integrator refuse for this model.
    """

    def __init__(self, model: Model | ModelBuilder, settings: Settings | None = None, **changes: Any):
        if isinstance(model, ModelBuilder):
            model = model.finalize()
        settings = (settings or Settings()).changed(**changes)
        self.settings = settings
        self._given_model = model
        self.model = model = settings.apply(model)
        self.frame = 0
        self.retried = 0
        self.failures: dict[int, str] = {}
        self._loop = Loop(model, settings)
        self._maker = self._loop
        self._context = self._loop.context
        self._moved = Moved(self._context, settings.dt, self._loop.pull, self._loop.shapes)
        self.state = self._context.state
        self._spares: dict[str, Simulation] = {}

    def step(self, frames: int = 1) -> None:
        """Advance by so many frames, with nothing between them: what is moved is moved in the first one and rests then.

        Raises:
            SimulationFailed: a frame diverged, or `Direct` did not converge, and `on_failure` does not help; or there
                were more contacts than room for them; or no copy of a replicated model is left (see `failures`). It is
                the last one made: `frame` and `state` are of it.
            InputError: frames is not a whole number of at least 1.
        """
        last = self.frame + check.whole("frames", frames, low=1)
        while self.frame < last:
            moves = self._moved.begin_frame(self.frame)
            self.frame += self._loop.make_frames(1 if moves or self._watch else last - self.frame)
            self._maker = self._loop
            failure = self._loop.find_failure()
            if failure is not None:
                self._recover(failure)
            self._look()

    def _recover(self, failure: Failure) -> None:
        """Make the frame just made again, as the settings say, or raise."""
        if failure[0] == "copies":
            self._note_failed(self._loop.find_failed_copies())
            return
        if failure[0] == "contacts":  # which no retry would help
            raise failed(self._when, self._snapshot(), failure)
        if not self._retry():
            error = failed(self._when, self._snapshot(), failure, retry.tried(self.settings), self.missed)
            self._loop.monitor.restart()  # the next frame, of a state that was put right, is judged by itself
            raise error
        self.retried += 1

    def reset(self) -> None:
        """Back to the initial state: what comes then is what came the first time."""
        self._moved.reset()
        self._context.w.assign(self.model.w)
        self.failures = {}
        self.state.x.assign(self.model.x)
        self.state.v.assign(self.model.v)
        if self.point_target is not None:
            self.point_target.assign(self.model.point.target)
        self.frame = self.retried = 0
        self._maker = self._loop
        self._look_anew()
        self._loop.restart()

    def go_back(self, frame: int, x: np.ndarray, v: np.ndarray, collider_motion: np.ndarray) -> None:
        """To `positions`, `velocities` and `collider_motion` of a frame that was. Go on with `continue_with`."""
        self.frame = frame
        self._context.put(x, v)
        self._moved.put_colliders(collider_motion)

    def like(self, settings: Settings | None = None, **changes: Any) -> Simulation:
        """Another simulation of the same model, in its initial state, with other settings."""
        return Simulation(self._given_model, settings or self.settings, **changes)

    def continue_with(self, settings: Settings | None = None, **changes: Any) -> Simulation:
        """Another simulation of the same model with other settings, which goes on from where this one is: its frame,
        positions, velocities, grabbed particle and point targets. Integrator and method begin anew."""
        other = self.like(settings, **changes)
        other._take_over(self)
        other.retried, other._watch = self.retried, self._watch
        return other

    def save(self, path: str | Path, extra: Mapping[str, Any] | None = None) -> None:
        """Write a checkpoint; see `Checkpoint.write`. extra: What the caller wants to find there again, as JSON."""
        arrays = {name: array.numpy() for name, array in self._context.arrays.items()}
        progress = {"frame": self.frame, "retried": self.retried, "moved": self._moved.memory}
        progress["failures"] = list(self.failures.items())
        Checkpoint(self._given_model, self.settings, progress, arrays, dict(extra or {})).write(path)

    @classmethod
    def load(cls, path: str | Path, device: str | wp.Device | None = None) -> Simulation:
        """The simulation that `save` wrote, model included; it goes on as if it had never stopped, bit for bit on the
        CPU.

        Args:
            device: Where to; the device it was on unless given.

        Raises:
            InputError: no such file, a truncated or damaged one, or one that is no checkpoint of this version.
        """
        checkpoint = Checkpoint.read(path, device)
        sim = cls(checkpoint.model, checkpoint.settings)
        sim._fill(checkpoint, path)
        return sim

    def restore(self, path: str | Path) -> None:
        """Go on from where `save` of a simulation of the same model and settings left a file.

        Raises:
            InputError: as `load`, or the file is of another model or other settings; nothing has changed then.
        """
        checkpoint = Checkpoint.read(path, self.model.device)
        checkpoint.refuse_other(self._given_model, self.settings, path)
        self._fill(checkpoint, path)

    def check(self) -> list[PreflightWarning]:
        """What is known to fail with these settings, worst first: each with its remedy, and with the name of its test,
        which is that of a map in the stability atlas. An estimate, from the graph and the state as they are now; an
        empty list is no promise. Reads the state back from the device."""
        return [warning for warning in preflight(self._snapshot()) if warning.severity > 1.0]

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.frame * self.settings.dt

    @property
    def point_target(self) -> wp.array | None:
        """Targets of the point constraints [m], Warp array [point_count]; may be written between frames."""
        return self._context.point_target

    @property
    def held(self) -> int | None:
        """The grabbed particle, None for none."""
        return self._moved.held

    @property
    def held_target(self) -> np.ndarray | None:
        """Where the grabbed particle is led to [m], float64 [3]; None without one."""
        return self._moved.held_target

    def grab(self, particle: int) -> None:
        """Take hold of a particle: it stays where it is until `move_to` or `release`, whatever pulls at it; with
        `grab_acceleration`, unless that is stronger."""
        self._moved.grab(particle)
        self._loop.forget_steps()

    def move_to(self, position: ArrayLike) -> None:
        """Where the grabbed particle is at the end of the next frame [m]; it gets there evenly over its steps, to
        round-off. With `grab_acceleration`: where it is pulled to."""
        self._moved.move_held(self.frame, position)

    def release(self) -> None:
        """Let go. A free particle keeps the velocity it was moved with; a fixed one stays where it is."""
        if self.held is not None:
            self._moved.release()
            self._loop.forget_steps()

    def lead(self, particles: ArrayLike, positions: ArrayLike) -> None:
        """Where fixed particles are at the end of the next frame; they get there evenly over its steps, to
        round-off, and rest there unless they are led on.

        Args:
            particles: Indices, shape [n]. All that are led in the next frame: another call replaces this one.
            positions: [m], shape [n, 3].

        Raises:
            InputError: a particle that is not fixed (grab those), or not as many positions as particles.
        """
        self._moved.move_fixed(self.frame, particles, positions)

    def move_collider(self, which: int, position: ArrayLike, rotation: ArrayLike = (0, 0, 0)) -> None:
        """Where a collider is at the end of the next frame; it gets there evenly over its steps, to round-off, and
        rests there unless it is moved on. What touches it is taken along by friction.

        Args:
            which: Its number, of one that `ModelBuilder.let_collider_move` lets move.
            position: Of its origin [m], [3]: a plane's point, a mesh's origin, the middle of everything else.
            rotation: From how it was added, axis times angle [rad]; by less than half a turn a frame.
        """
        self._moved.move_collider(self.frame, which, position, rotation)

    def __repr__(self) -> str:
        return f"Simulation({self.model!r}, frame {self.frame} of {self.dt:g} s, {self.settings})"

    @property
    def _when(self) -> str:
        return f"frame {self.frame} (t = {self.time:.6g} s)"

    def _retry(self) -> bool:
        """Make a failed frame again from its start, with settings that are more robust, until an attempt succeeds;
        then go on with the own ones. Integrator and method begin anew: what they remember is of another step."""
        for name, settings in retry.attempts(self.settings):
            if name not in self._spares:
                self._spares[name] = Simulation(self._given_model, settings)
            spare = self._spares[name]
            spare._take_over(self, self._loop.start)
            spare.frame -= 1
            try:
                spare.step()
            except SimulationFailed:
                continue
            self._take_over(spare)
            self._maker = spare._maker
            return True
        return False

    def _note_failed(self, copies: Mapping[int, Failure]) -> None:
        new = {k: failure for k, failure in copies.items() if k not in self.failures}
        self.failures |= failed_copies(self._when, self._snapshot(), new, self.missed)
        self._loop.lay_to_rest(list(new))
        if len(self.failures) == self.model.copy_count:
            raise SimulationFailed(f"all {self.model.copy_count} copies have diverged, copy 0 in {self.failures[0]}")

    def _take_over(self, other: Simulation, state: State | None = None) -> None:
        """Go on from where `other`, a simulation of the same model, is (or from a `state` of it)."""
        mine, theirs = self._context, other._context
        wp.copy(self.state.x, (state or other.state).x)
        wp.copy(self.state.v, (state or other.state).v)
        wp.copy(mine.w, theirs.w)
        if mine.point_target is not None:
            wp.copy(mine.point_target, theirs.point_target)
        if self._loop.counters is not None and other._loop.counters is not None:
            wp.copy(self._loop.counters, other._loop.counters)
        self._moved.take_over(other._moved, state is not None)
        self.frame, self.failures = other.frame, dict(other.failures)
        self._maker = self._loop
        self._loop.restart()

    def _fill(self, checkpoint: Checkpoint, path: str | Path) -> None:
        memory = self._moved.checked(checkpoint.progress.get("moved"))
        checkpoint.fill(self._context.arrays, self._context.fixed, path)
        self.frame, self.retried = checkpoint.progress["frame"], checkpoint.progress["retried"]
        self.failures = dict(checkpoint.progress["failures"])
        self._maker = self._loop
        self._moved.restore(memory)
        self._look_anew()

    def _snapshot(self) -> Snapshot:
        x, v, w = (array.numpy().astype(np.float64) for array in (self.state.x, self.state.v, self._context.w))
        self._moved.where_held(x)
        target = np.zeros((0, 3)) if self.point_target is None else self.point_target.numpy().astype(np.float64)
        return Snapshot(self.model, self.settings, x, v, w, target, self.collider_overlaps)
