"""A running scene that pages look at and act on, without any network."""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pbd_warp.cost import cost_sheet
from pbd_warp.errors import InputError, SimulationFailed, unknown
from pbd_warp.grab.grabber import Grabber
from pbd_warp.grab.recording import CHANGE, Recording, interactive, summary
from pbd_warp.measure import measure
from pbd_warp.scene import Scene, load_scene, scene_names
from pbd_warp.settings import Settings
from pbd_warp.simulation import Simulation
from pbd_warp.step.integrators import INTEGRATORS
from pbd_warp.step.methods import METHODS, Direct
from pbd_warp.usd.writer import shown_widths
from pbd_warp.view import messages as say
from pbd_warp.view.surroundings import describe

HEADER = struct.Struct("<IIiI")
"""Of a frame: generation, frame, the held particle or -1, the page that holds it or 0; then positions, float32 xyz."""

MOST_SWEEPS = 8192
"""Substeps times iterations. Above, a change of settings takes seconds: a frame is captured launch by launch."""

SMOOTHING = 0.1
"""Of the time a frame takes: the weight of the newest."""


class Session:
    """One scene at a time, simulated with settings that may change, led by one hand, recorded from its initial state.

    Not for several threads at once: whoever has several calls it from one at a time.

    Args:
        scene: The first scene, with its settings. source: Its name, or its file; seed, parameters: what
            `load_scene` made it from.
        device, dtype: Of all simulations.

    Attributes:
        paused: Whether `advance` does nothing.
        failure: Why the simulation has stopped, None while it has not.
        generation: Counts models: what belongs to another one is out of date.
        holder: The page whose hand it is, None while it holds nothing.
        recording: What was done since the initial state.

    Raises:
        InputError: what the scene's model or simulation refuse.
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
        self._first = scene
        self._sources = {name: name for name in scene_names()} | {scene.name: source}
        self._made_from = seed, dict(parameters or {})
        self._device, self._dtype = device, dtype
        self.paused = False
        self.generation = 0
        self.holder: int | None = None
        self.failure: str | None = None
        self.recording: Recording
        self._open(scene)

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
            case say.Click():
                self._click(who, message)
            case say.Move():
                if who == self.holder:
                    self.grabber.hover(message.camera, message.at)
            case say.Release():
                self.leave(who)
            case say.Pause():
                self.paused = message.on
            case say.Step():
                self._refuse_if_stopped()
                self.paused = True
                self._step()
            case say.Reset():
                self._begin(self.settings)
            case say.Change():
                self._change(message.changes)
            case say.Load():
                self._load(message.scene)

    def leave(self, who: int) -> None:
        """Let go of what a page holds."""
        if who == self.holder:
            self.grabber.deselect()
            self.holder = None

    @property
    def frame(self) -> int:
        """Frames done since the initial state."""
        return self.recording.frames - 1

    def positions(self) -> np.ndarray:
        """Of the last frame that went well [m], float32 [particle_count, 3]."""
        return self._positions

    def packet(self) -> bytes:
        """The last frame as pages get it: HEADER, positions."""
        held = -1 if self.grabber.particle is None else self.grabber.particle
        return HEADER.pack(self.generation, self.frame, held, self.holder or 0) + self._positions.tobytes()

    def description(self) -> dict[str, Any]:
        """What pages need to know of a scene once."""
        return {
            "generation": self.generation,
            "scene": self.scene.name,
            "scenes": sorted(self._sources),
            "methods": list(METHODS),
            "integrators": list(INTEGRATORS),
            "fps": self.scene.fps,
            **describe(self.model),
        }

    def status(self) -> dict[str, Any]:
        """What pages show in figures. None is what is not finite, or not there."""
        with np.errstate(all="ignore"):
            now = measure(self.sim)
        settings = self.settings
        return {
            "frame": self.frame,
            "time": self.frame * self.sim.dt,
            "paused": self.paused,
            "failure": self.failure,
            "ms": 1e3 * self._seconds,
            "max_stretch": _finite(now.max_stretch),
            "residual": _finite(now.residual),
            "energy": _finite(now.energy),
            "settings": {
                "method": settings.method.name,
                "iterations": settings.method.iterations,
                "integrator": settings.integrator,
                "substeps": settings.substeps,
                "damping": settings.damping,
                "stiffness": self._stiffness(),
                "gravity": self.sim.model.gravity.tolist(),
            },
            "cost": self._cost,
        }

    def save(self, path: Path) -> None:
        """Write the recording."""
        self.recording.save(path)

    def _open(self, scene: Scene) -> None:
        model = scene.builder.finalize(device=self._device, dtype=self._dtype)
        settings = interactive(scene.settings)
        sim = Simulation(model, settings)
        self.scene, self.model = scene, model
        self.generation += 1
        self._start(settings, sim)

    def _begin(self, settings: Settings) -> None:
        self._start(settings, Simulation(self.model, settings))

    def _start(self, settings: Settings, sim: Simulation) -> None:
        """From the initial state, with a recording of its own."""
        self._use(settings, sim)
        self.grabber = Grabber(sim, lambda gesture, value: self.recording.note(self.frame, gesture, value))
        self.holder = self.failure = None
        seed, parameters = self._made_from if self.scene is self._first else (None, {})
        self.recording = Recording(*(self.scene.name, seed, parameters, summary(self.model), self._dtype, settings))
        self._positions = self.sim.state.x.numpy().astype(np.float32)

    def _use(self, settings: Settings, sim: Simulation) -> None:
        self.settings, self.sim = settings, sim
        self._cost = cost_sheet(sim)
        self._seconds = 0.0

    def _step(self) -> bool:
        start = time.perf_counter()
        try:
            self.sim.step()
        except SimulationFailed as error:
            self.failure = str(error)
            self.holder = None
            return False
        self._positions = self.sim.state.x.numpy().astype(np.float32)
        seconds = time.perf_counter() - start
        self._seconds += (SMOOTHING if self._seconds else 1.0) * (seconds - self._seconds)
        self.recording.frames += 1
        return True

    def _click(self, who: int, click: say.Click) -> None:
        self._refuse_if_stopped()
        if self.holder not in (None, who):
            raise InputError(f"page {self.holder} is dragging; wait until it lets go")
        self.grabber.click(click.camera, click.at, self._radius())
        self.holder = who if self.grabber.particle is not None else None

    def _change(self, changes: Mapping[str, Any]) -> None:
        new = self._changed(**changes)
        if changes.keys() & {"method", "iterations", "substeps"}:
            sweeps = new.whole_substeps * new.method.iterations
            if sweeps > MOST_SWEEPS:
                raise InputError(
                    f"{new.substeps} substeps of {new.method.iterations} iterations are too much for a live view; "
                    f"their product must be at most {MOST_SWEEPS}"
                )
        if self.failure is not None:
            self._begin(new)  # there is no state to go on from
            return
        sim = self.sim.continue_with(new)
        self._use(new, sim)
        self.grabber.sim = sim
        self.recording.note(self.frame, CHANGE, new)

    def _changed(self, *, method: str | None = None, iterations: int | None = None, **others: Any) -> Settings:
        """The present settings with others in their place: `method` by its name, its `iterations`, and any other.

        The scene's own method comes as the scene has it. Another one begins with its defaults, but keeps the number of
        iterations, unless one of the two is `Direct`, to which the number is only a limit.
        """
        new, own = self.settings.changed(**others), self.scene.settings.method
        if method is not None and method != new.method.name:
            if method == own.name:
                new = new.changed(method=own)
            elif Direct.name in (method, new.method.name):
                new = new.with_method(method)
            else:
                new = new.with_method(method, iterations=new.method.iterations)
        return new if iterations is None else new.with_method(iterations=iterations)

    def _load(self, name: str) -> None:
        if name not in self._sources:
            raise unknown("scene", name, self._sources)
        self._open(self._first if name == self._first.name else load_scene(self._sources[name]))

    def _refuse_if_stopped(self) -> None:
        if self.failure is not None:
            raise InputError("the simulation has stopped; reset it first")

    def _radius(self) -> np.ndarray:
        return 0.5 * shown_widths(self.model)

    def _stiffness(self) -> float | None:
        """Of all distances, None where they differ."""
        stiffness = np.unique(self.sim.model.distance.stiffness)
        return float(stiffness[0]) if len(stiffness) == 1 else None


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
