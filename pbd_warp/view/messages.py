"""What a page may say. Everything is checked here: what comes out makes sense, or is an InputError."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pbd_warp.errors import InputError, unknown
from pbd_warp.grab.drawing import DrawnRope
from pbd_warp.view.changes import CHANGES, parse_changes
from pbd_warp.view.values import boolean, text, vector, whole

LARGEST = 16384
"""Characters of a message."""

FARTHEST = 1e6
"""A target beyond this [m] is a mistake: what is dragged there would be lost to rounding."""

MOST_OF_A_PARAMETER = 20_000
"""Largest number that a page may give for a parameter of a scene: mostly it counts particles."""


@dataclass(frozen=True)
class Select:
    """Grab a particle that is seen in a frame of a model (`Session.generation`)."""

    particle: int
    frame: int
    generation: int


@dataclass(frozen=True)
class Move:
    """Where the grabbed particle is to be [m]."""

    position: tuple[float, float, float]


@dataclass(frozen=True)
class Release:
    """Let go."""


@dataclass(frozen=True)
class Pause:
    on: bool


@dataclass(frozen=True)
class Step:
    """One frame, while paused."""


@dataclass(frozen=True)
class Reset:
    """Back to the initial state."""


@dataclass(frozen=True)
class Rewind:
    """Pause, and show a frame that was; what is done next goes on from there."""

    frame: int


@dataclass(frozen=True)
class Record:
    """Begin to keep frames, or end it."""

    on: bool


@dataclass(frozen=True)
class Change:
    """Other settings: arguments of `Settings.changed`."""

    changes: Mapping[str, Any]


@dataclass(frozen=True)
class Open:
    """Another scene, or the present one as it was at first, with parameters and with changes of its settings."""

    scene: str
    parameters: Mapping[str, str]
    changes: Mapping[str, Any]


@dataclass(frozen=True)
class Rope:
    """Add a rope and start over."""

    rope: DrawnRope


@dataclass(frozen=True)
class Seen:
    """So many frames has the page received."""

    count: int


Message = Select | Move | Release | Pause | Step | Reset | Rewind | Record | Change | Open | Rope | Seen


def parse(said: str | bytes) -> Message:
    """The message of a page.

    Raises:
        InputError: anything else.
    """
    if isinstance(said, bytes):
        raise InputError("a message must be text")
    if len(said) > LARGEST:
        raise InputError(f"a message must have at most {LARGEST} characters")
    try:
        data = json.loads(said)
    except (ValueError, RecursionError):
        raise InputError("a message must be JSON") from None
    if not isinstance(data, dict):
        raise InputError("a message must be an object")
    kind = data.pop("type", None)
    if not isinstance(kind, str) or kind not in _PARSERS:
        raise unknown("message", kind, _PARSERS)
    fields, make = _PARSERS[kind]
    if set(data) != set(fields):
        raise InputError(f"message {kind} must have {', '.join(fields) or 'nothing else'}")
    return make(**data)


def _change(changes: Any) -> Change:
    if not changes:
        raise InputError(f"changes must be an object with some of {', '.join(CHANGES)}")
    return Change(parse_changes(changes))


def _open(scene: Any, parameters: Any, changes: Any) -> Open:
    if not isinstance(parameters, dict) or not all(isinstance(value, str) for value in parameters.values()):
        raise InputError("parameters must be an object of texts")
    for name, value in parameters.items():
        try:
            size = abs(float(value))
        except ValueError:
            continue  # a word; the scene says whether it knows it
        if not size <= MOST_OF_A_PARAMETER:
            raise InputError(f"parameter {name} must be at most {MOST_OF_A_PARAMETER} in a live view, not {value}")
    return Open(text("scene", scene), parameters, parse_changes(changes))


def _rope(points: Any, pinned: Any) -> Rope:
    if not isinstance(points, list):
        raise InputError("points must be a list")
    places = [list(vector("a point of the rope", point, FARTHEST)) for point in points]
    return Rope(DrawnRope.from_json({"points": places, "pinned": pinned}))


_PARSERS: dict[str, tuple[tuple[str, ...], Callable[..., Message]]] = {
    "select": (
        ("particle", "frame", "generation"),
        lambda **given: Select(**{name: whole(name, value) for name, value in given.items()}),
    ),
    "move": (("position",), lambda position: Move(vector("position", position, FARTHEST))),
    "release": ((), Release),
    "pause": (("on",), lambda on: Pause(boolean("pause", on))),
    "step": ((), Step),
    "reset": ((), Reset),
    "rewind": (("frame",), lambda frame: Rewind(whole("frame", frame))),
    "record": (("on",), lambda on: Record(boolean("record", on))),
    "change": (("changes",), _change),
    "open": (("scene", "parameters", "changes"), _open),
    "rope": (("points", "pinned"), _rope),
    "seen": (("count",), lambda count: Seen(whole("count", count))),
}
