"""Recordings of what was done to a running scene, from which the same motion can be made again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from pbd_warp import check
from pbd_warp.atomic import write_text
from pbd_warp.errors import InputError
from pbd_warp.grab.drag import GESTURES
from pbd_warp.grab.drawing import DrawnRope, with_ropes
from pbd_warp.grab.grabber import Grabber
from pbd_warp.model.model import Model
from pbd_warp.scene import Scene, load_scene
from pbd_warp.settings import Settings, frame_length
from pbd_warp.simulation import Simulation

CHANGE = "settings"
"""The event beside the three gestures: the simulation goes on with other settings."""


@dataclass
class Recording:
    """What was done from the initial state on.

    scene, seed, parameters: What was built (`load_scene`); ropes: what was drawn into it; model: a few numbers by which
    it is known again.
    dtype, settings: How it was simulated at the start.
    frames: How many there are, the initial state included.
    events: (frame, gesture or "settings", value), in the order in which they happened. `frame` frames were done before.
    """

    scene: str
    seed: int | None
    parameters: dict[str, str]
    model: dict[str, float]
    dtype: str
    settings: Settings
    frames: int = 1
    events: list[tuple[int, str, Any]] = field(default_factory=list)
    ropes: list[DrawnRope] = field(default_factory=list)

    def note(self, frame: int, what: str, value: Any) -> None:
        """Add an event. A frame has one move: of several the last counts."""
        if what == "move" and self.events and self.events[-1][:2] == (frame, what):
            self.events.pop()
        self.events.append((frame, what, value))

    def cut(self, frame: int) -> tuple[Settings, int | None]:
        """Forget what came after a frame; the settings then, and the particle that was grabbed (None for none)."""
        self.frames = frame + 1
        self.events = [event for event in self.events if event[0] < frame]
        settings, held = self.settings, None
        for _, what, value in self.events:
            if what == CHANGE:
                settings = value
            elif what != "move":
                held = value  # None with a deselect
        return settings, held

    @property
    def all_settings(self) -> list[Settings]:
        """Those of the start, and all that they are changed to."""
        return [self.settings, *(value for _, what, value in self.events if what == CHANGE)]

    def events_as_json(self) -> list[list[Any]]:
        """The events as they come back from a file."""
        events = [[frame, what, value.to_json() if what == CHANGE else value] for frame, what, value in self.events]
        return json.loads(json.dumps(events))

    def to_text(self) -> str:
        """As JSON, an event a line, so that the file can be read and compared."""
        header = {**vars(self), "settings": self.settings.to_json(), "ropes": [rope.to_json() for rope in self.ropes]}
        lines = ",\n  ".join(json.dumps(event) for event in self.events_as_json())
        text = json.dumps({**header, "events": []}, indent=1).replace('"events": []', f'"events": [\n  {lines}\n ]')
        return text + "\n"

    def save(self, path: Path) -> None:
        """Write it as JSON, whole or not at all.

        Raises:
            SimulationFailed: it could not be written.
        """
        write_text(path, self.to_text())

    @classmethod
    def load(cls, path: Path, scene: str | None = None) -> Recording:
        """Read what `save` wrote, also that of version 0.1.

        Args:
            scene: The scene that it is of: its name, or its file. The name in the recording unless given.

        Raises:
            InputError: no such file, or anything in it that `save` would not have written.
        """
        try:
            data = json.loads(check.ordinary(path).read_text())
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"{path} is no recording of drags: {error}") from None
        names = [field.name for field in fields(cls)]
        if isinstance(data, dict) and "scene_settings" in data:
            try:
                data = _upgraded(data, scene)
            except (InputError, KeyError, TypeError, ValueError, AttributeError) as error:
                raise InputError(f"{path} is no recording of drags: {error}") from None
        if isinstance(data, dict):
            data.setdefault("ropes", [])  # which older files do not have
        if not isinstance(data, dict) or sorted(data) != sorted(names):
            raise InputError(f"{path} is no recording of drags: it must have {', '.join(names)}")
        try:
            return cls(**_checked(data))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None

    def load_scene(self, name: str) -> Scene:
        """The scene that this is a recording of, by its name or its file, with the settings of the start.

        Raises:
            InputError: another scene.
        """
        if Path(name).stem != self.scene:
            raise InputError(f"the drags are of scene {self.scene}, not of {name}")
        scene = load_scene(name, self.seed, self.parameters).changed(settings=self.settings)
        return with_ropes(scene, self.ropes)

    def replay(self, scene: Scene, model: Model) -> Replay:
        """Do it again.

        Raises:
            InputError: the model is not the one that this is a recording of, or settings of it make no simulation.
        """
        now = summary(model)
        same = now.keys() == self.model.keys() and all(
            np.isclose(now[key], self.model[key], rtol=1e-6, atol=1e-9) for key in now
        )
        if not same:
            raise InputError(f"scene {scene.name} is not what it was when the drags were recorded: record them anew")
        selected = [value for _, what, value in self.events if what == "select"]
        check.indices("drags: select", selected, model.particle_count)
        tried: list[Settings] = []
        for number, (_, what, value) in enumerate(self.events):
            if what == CHANGE and value not in tried:
                tried.append(value)
                try:
                    Simulation(model, value)
                except InputError as error:
                    raise InputError(f"drags: event {number}: {error}") from None
        return Replay(self, model)


def summary(model: Model) -> dict[str, float]:
    """A few numbers by which a model is known again, whatever rounding another machine builds it with."""
    arrays = {
        "x": model.x,
        "v": model.v,
        "w": model.w,
        "radius": model.radius,
        "rest_length": model.distance.rest_length,
        "compliance": model.distance.compliance,
        "stiffness": model.distance.stiffness,
        "target": model.point.target,
        "collider": model.colliders.centre,
    }
    counts = {"particles": float(model.particle_count), "constraints": float(model.constraint_count)}
    return counts | {name: float(np.linalg.norm(array)) for name, array in arrays.items()}


class Replay:
    """Does again what a recording holds; made by `Recording.replay`."""

    def __init__(self, recording: Recording, model: Model):
        self._recording, self._model = recording, model
        self._next = 0
        self._grabber: Grabber | None = None

    def begin(self) -> Simulation:
        """The simulation in its initial state."""
        sim = Simulation(self._model, self._recording.settings)
        self._grabber = Grabber(sim)
        return sim

    @property
    def memory(self) -> dict[str, Any]:
        """For a checkpoint: how many of the events are done."""
        return {"next": self._next}

    @property
    def script(self) -> list[Any]:
        """All events."""
        return self._recording.events_as_json()

    def resume(self, memory: dict[str, Any], sim: Simulation) -> Simulation:
        """Go on from a checkpoint, with the settings in force there.

        Raises:
            InputError: this recording would not have left that.
        """
        done = memory.get("next") if isinstance(memory, dict) else None
        self._next = check.whole("events done before the checkpoint", done, low=0, high=len(self._recording.events))
        changes = [value for _, what, value in self._recording.events[: self._next] if what == CHANGE]
        if changes:
            sim = Simulation(self._model, changes[-1])
        self._grabber = Grabber(sim)
        return sim

    def advance(self, sim: Simulation) -> Simulation:
        """Do what was done before the frame that `step()` makes next, of the simulation that this returns."""
        assert self._grabber is not None
        events = self._recording.events
        while self._next < len(events) and events[self._next][0] <= sim.frame:
            _, what, value = events[self._next]
            self._next += 1
            if what == CHANGE:
                self._grabber.sim = sim = sim.continue_with(value)
            elif what == "select":
                self._grabber.select(value)
            elif what == "move":
                self._grabber.move(value)
            else:
                self._grabber.deselect()
        return sim


def _upgraded(data: dict[str, Any], scene: str | None) -> dict[str, Any]:
    """What version 0.1 wrote, which had only those settings that the view could change."""
    data = dict(data)
    data["parameters"] = data.pop("scene_settings")
    dt = frame_length("fps", data.pop("fps"))
    rest = interactive(load_scene(scene or data["scene"], data["seed"], data["parameters"]).settings)
    whole = json.loads(json.dumps(rest.changed(dt=dt).to_json()))
    data["settings"] = {**whole, **data["settings"]}
    data["events"] = [
        [frame, what, {**whole, **value} if what == CHANGE else value] for frame, what, value in data["events"]
    ]
    return data


def interactive(settings: Settings) -> Settings:
    """Settings for a simulation that is grabbed: a mouse asks for what Newton's method does not always find, and the
    next frame makes up for it."""
    return settings.changed(on_failure="continue") if settings.on_failure == "raise" else settings


def _checked(data: dict[str, Any]) -> dict[str, Any]:
    """The fields of a recording from what was read, each checked."""
    for name in ("scene", "dtype"):
        if not isinstance(data[name], str):
            raise InputError(f"{name} must be a text")
    texts, numbers = data["parameters"], data["model"]
    if not isinstance(texts, Mapping) or not all(isinstance(value, str) for value in texts.values()):
        raise InputError("parameters must be a table of texts")
    if not isinstance(numbers, Mapping):
        raise InputError("model must be a table of numbers")
    data["model"] = {key: check.number(f"model: {key}", value) for key, value in numbers.items()}
    if data["seed"] is not None:
        check.whole("seed", data["seed"], low=0)
    check.whole("frames", data["frames"], low=1)
    data["settings"] = Settings.from_json(data["settings"])
    if not isinstance(data["events"], list):
        raise InputError("events must be a list")
    last, holding = 0, False
    events = []
    for number, event in enumerate(data["events"]):
        at = f"event {number}"
        if not isinstance(event, list) or len(event) != 3:
            raise InputError(f"{at} must be [frame, what, value]")
        frame, what, value = check.whole(f"{at}: frame", event[0], low=0), event[1], event[2]
        if frame < last:
            raise InputError(f"{at}: frame {frame} comes after frame {last}; a recording goes forward in time")
        if what in ("move", "deselect") and not holding:
            raise InputError(f"{at}: {what} without a selected particle")
        if what == "select":
            check.whole(f"{at}: particle", value, low=0)
        elif what == "move":
            check.vector(f"{at}: position", value)
        elif what == CHANGE:
            value = Settings.from_json(value)
        elif what != "deselect":
            raise InputError(f"{at}: {what!r} is none of {', '.join(GESTURES)}, {CHANGE}")
        last = frame
        holding = what in ("select", "move") or (holding and what == CHANGE)
        events.append((frame, what, value))
    if not isinstance(data["ropes"], list):
        raise InputError("ropes must be a list")
    return {**data, "events": events, "ropes": [DrawnRope.from_json(rope) for rope in data["ropes"]]}
