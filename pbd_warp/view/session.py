"""A running scene that pages look at and act on, without any network."""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pbd_warp.errors import InputError, SimulationFailed, unknown
from pbd_warp.grab.drawing import DrawnRope, with_ropes
from pbd_warp.grab.grabber import Grabber
from pbd_warp.grab.recording import CHANGE, Recording, summary
from pbd_warp.run import provenance
from pbd_warp.scene import Scene, load_scene, scene_names
from pbd_warp.settings import Settings
from pbd_warp.simulation import Simulation
from pbd_warp.view import messages as say
from pbd_warp.view.changes import changed, pulling
from pbd_warp.view.history import Clip, Frames

HEADER = struct.Struct("<IIiI3f")
"""Of a frame: generation, frame, the grabbed particle or -1, the page that holds it or 0, where it is pulled to [m];
then positions, float32 xyz; then tensions of the distances [N], float32, where the method knows them."""

SMOOTHING = 0.1
"""Of the time a frame takes: the weight of the newest."""


class Session:
    """One scene at a time, simulated with settings that may change, dragged by one page at a time, recorded from its
    initial state. `begin` builds the simulation, and must come first.

    Not for several threads at once: whoever has several calls it from one at a time.

    Args:
        scene: The first scene, with its settings. source: Its name, or its file; seed, parameters: what
            `load_scene` made it from.
        device, dtype: Of all simulations.

    Attributes:
        paused: Whether `advance` does nothing.
        failure: Why the simulation has stopped, None while it has not.
        generation: Counts models: what belongs to another one is out of date.
        holder: The page that holds a particle, None while none does.
        recording: What was done since the initial state.
        clip: The frames that were kept last, None before that.
        notes: Sentences for all pages, which whoever shows them takes out.
    """

    def __init__(
        self,
        scene: Scene,
        source: str,
        device: str | None = None,
        dtype: str = "float32",
        seed: int | None = None,
        parameters: Mapping[str, str] | None = None,
    ):
        self.scene, self._first = scene, scene
        self.sources = {name: name for name in scene_names()} | {scene.name: source}
        self.made_from = self._first_made_from = seed, dict(parameters or {})
        self._device, self.dtype = device, dtype
        self.paused = False
        self.generation = 0
        self.holder: int | None = None
        self.failure: str | None = None
        self.clip: Clip | None = None
        self.notes: list[str] = []
        self.seconds = 0.0
        self.recording: Recording
        self._kept_from: int | None = None
        self._back: int | None = None

    def begin(self) -> None:
        """Build the first simulation; compiles what is not compiled yet.

        Raises:
            InputError: what the scene's model or simulation refuse.
        """
        self._open(self.scene, pulling(self.scene.settings), self.made_from, [], self.dtype)

    def advance(self) -> bool:
        """Simulate a frame, unless paused or stopped; whether there is a new one."""
        return self.running and self._step()

    @property
    def running(self) -> bool:
        """Whether simulated time goes by."""
        return not self.paused and self.failure is None

    def do(self, who: int, message: say.Message) -> None:
        """What a page asks for.

        Raises:
            InputError: it cannot be done; nothing has changed.
        """
        match message:
            case say.Select():
                self._select(who, message)
            case say.Move():
                if who == self.holder:
                    self.grabber.move(message.position)
            case say.Release():
                self.leave(who)
            case say.Pause():
                self.paused = message.on
                if not message.on:
                    self._return()
            case say.Step():
                self._refuse_if_stopped()
                self.paused = True
                self._step()
            case say.Reset():
                self._start(self.settings, Simulation(self.model, self.settings))
            case say.Rewind():
                self._rewind(message.frame)
            case say.Record():
                self._record(message.on)
            case say.Change():
                self._change(message.changes)
            case say.Open():
                self._load(message)
            case say.Rope():
                ropes = [*self.recording.ropes, message.rope]
                self._open(self.scene, self.settings, self.made_from, ropes, self.dtype)

    def leave(self, who: int) -> None:
        """Let go of what a page holds."""
        if who == self.holder:
            self.grabber.deselect()
            self.holder = None

    @property
    def frame(self) -> int:
        """Frames done since the initial state, or the one that was gone back to."""
        return self.frames.last if self._back is None else self._back

    @property
    def kept(self) -> int | None:
        """Frames kept so far, if any are to be."""
        return None if self._kept_from is None else self.frames.last - self._kept_from + 1

    def positions(self) -> np.ndarray:
        """Of the last frame that went well, or of the one gone back to [m], float32 [particle_count, 3]."""
        return self.frames.at(self.frame).x.astype(np.float32)

    def packet(self) -> bytes:
        """The last frame as pages get it: HEADER, positions."""
        held = -1 if self.grabber.particle is None else self.grabber.particle
        target = np.zeros(3) if self.sim.held_target is None else self.sim.held_target
        header = HEADER.pack(self.generation, self.frame, held, self.holder or 0, *target)
        return header + self.positions().tobytes() + self.frames.at(self.frame).tension.tobytes()

    def clip_now(self) -> Clip:
        """What is to be saved: the frames that are kept, or were kept last; without any, the last ten seconds."""
        if self._kept_from is not None:
            return self._clip(self._kept_from)
        return self.clip or self._clip(self.frames.first)

    def _clip(self, first: int) -> Clip:
        about = provenance(self.scene.changed(settings=self.settings), self.model)
        return Clip(self.scene.name, self.model, self.scene.fps, self.frames.since(first), about)

    def _open(
        self,
        scene: Scene,
        settings: Settings,
        made_from: tuple[int | None, dict[str, str]],
        ropes: Sequence[DrawnRope],
        dtype: str,
    ) -> None:
        """Another model."""
        model = with_ropes(scene, ropes).builder.finalize(device=self._device, dtype=dtype)
        sim = Simulation(model, settings)
        self._record(False)
        self.scene, self.model, self.made_from, self.dtype = scene, model, made_from, dtype
        self.generation += 1
        self._start(settings, sim, ropes)

    def _start(self, settings: Settings, sim: Simulation, ropes: Sequence[DrawnRope] | None = None) -> None:
        """From the initial state, with a recording of its own."""
        self._record(False)
        ropes = self.recording.ropes if ropes is None else list(ropes)
        self._use(settings, sim)
        self.grabber = Grabber(sim, lambda gesture, value: self.recording.note(self.frame, gesture, value))
        self.holder = self.failure = self._back = None
        seed, parameters = self.made_from
        known = summary(self.model)
        self.recording = Recording(self.scene.name, seed, parameters, known, self.dtype, settings, ropes=ropes)
        self.frames = Frames(self.scene.fps)
        self._keep_state()

    def _use(self, settings: Settings, sim: Simulation) -> None:
        self.settings, self.sim = settings, sim
        self.seconds = 0.0

    def _keep_state(self) -> None:
        self.frames.add(self.sim)
        if self.frames.keep and self.frames.full:
            self._record(False)
            self.notes.append(
                f"recording has ended: there is no room for more than {len(self.clip_now().states)} frames"
            )

    def _step(self) -> bool:
        self._return()
        start = time.perf_counter()
        try:
            self.sim.step()
        except SimulationFailed as error:
            self.failure = str(error)
            self.holder = None
            return False
        seconds = time.perf_counter() - start
        self._keep_state()
        self.seconds += (SMOOTHING if self.seconds else 1.0) * (seconds - self.seconds)
        self.recording.frames += 1
        return True

    def _select(self, who: int, wanted: say.Select) -> None:
        self._refuse_if_stopped()
        if self.holder not in (None, who):
            raise InputError(f"page {self.holder} is dragging; wait until it lets go")
        if wanted.generation != self.generation or wanted.frame > self.frame:
            raise InputError("what was clicked is there no more: the scene has started anew meanwhile")
        self._return()
        self.grabber.select(wanted.particle)
        self.holder = who
        if self.settings.grab_acceleration is not None and wanted.frame >= self.frames.first:
            self.grabber.move(self.frames.at(wanted.frame).x[wanted.particle])  # where it was seen: under the cursor

    def _change(self, changes: Mapping[str, Any]) -> None:
        others = {name: value for name, value in changes.items() if name != "dtype"}
        new = changed(self.settings, self.scene.settings, **others)
        dtype = changes.get("dtype", self.dtype)
        if dtype != self.dtype:
            self._open(self.scene, new, self.made_from, self.recording.ropes, dtype)
        elif self.failure is not None:
            self._start(new, Simulation(self.model, new))  # there is no state to go on from
        else:
            self._return()
            sim = self.sim.continue_with(new)
            self._use(new, sim)
            self.grabber.sim = sim
            self.recording.note(self.frame, CHANGE, new)

    def _load(self, wanted: say.Open) -> None:
        if wanted.scene not in self.sources:
            raise unknown("scene", wanted.scene, self.sources)
        scene, made_from = self._first, self._first_made_from
        if wanted.scene != scene.name or wanted.parameters:
            made_from = None, dict(wanted.parameters)
            scene = load_scene(self.sources[wanted.scene], None, wanted.parameters)
        changes = {name: value for name, value in wanted.changes.items() if name != "dtype"}
        settings = changed(pulling(scene.settings), scene.settings, **changes)
        self._open(scene, settings, made_from, [], wanted.changes.get("dtype", self.dtype))

    def _rewind(self, frame: int) -> None:
        """Show a frame that was; nothing is lost yet."""
        self.frames.at(frame)
        if self.holder is not None:
            self.leave(self.holder)
        self.paused = True
        self._back = frame if frame != self.frames.last or self.failure is not None else None

    def _return(self) -> None:
        """Go on from the frame gone back to: let go, and begin integrator and method anew, as a replay does."""
        if self._back is None:
            return
        frame, self._back, self.failure = self._back, None, None
        settings, held = self.recording.cut(frame)
        x, v, _, motion = self.frames.cut(frame)
        self.sim.release()
        if held is not None:
            if self.model.w[held] == 0.0:
                v = np.where(np.arange(len(v))[:, None] == held, 0.0, v)
            self.recording.note(frame, "deselect", None)
        self.sim.go_back(frame, x, v, motion)
        self._use(settings, self.sim.continue_with(settings))
        self.grabber.sim = self.sim
        self.recording.note(frame, CHANGE, settings)
        if self._kept_from is not None:
            self._kept_from = min(self._kept_from, frame)

    def _record(self, on: bool) -> None:
        if on and self._kept_from is None:
            self._return()
            self._kept_from, self.frames.keep = self.frames.last, True
        elif not on and self._kept_from is not None:
            self.clip = self._clip(self._kept_from)
            self._kept_from, self.frames.keep = None, False

    def _refuse_if_stopped(self) -> None:
        if self.failure is not None and self._back is None:
            raise InputError("the simulation has stopped; reset it first")
