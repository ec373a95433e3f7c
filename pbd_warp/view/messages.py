"""What a page may say. Everything is checked here: what comes out makes sense, or is an InputError."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.grab.drawing import DrawnRope
from pbd_warp.model.builder import DTYPES

LARGEST = 16384
"""Characters of a message."""

MOST_SUBSTEPS, MOST_ITERATIONS = 512, 512
MOST_CONTACTS = 1_000_000
MOST_GRAVITY = 1000.0  # m/s^2
MOST_PULL = 1e6  # m/s^2
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


def parse(text: str | bytes) -> Message:
    """The message of a page.

    Raises:
        InputError: anything else.
    """
    if isinstance(text, bytes):
        raise InputError("a message must be text")
    if len(text) > LARGEST:
        raise InputError(f"a message must have at most {LARGEST} characters")
    try:
        data = json.loads(text)
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


def _number(name: str, value: Any) -> float:
    """A number that is written as one: neither a text nor true or false."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{name} must be a number")
    return check.number(name, value)


def _vector(name: str, values: Any, limit: float) -> tuple[float, float, float]:
    if not isinstance(values, list) or len(values) != 3:
        raise InputError(f"{name} must be 3 numbers")
    x, y, z = (check.number(name, _number(name, value), low=-limit, high=limit) for value in values)
    return x, y, z


def _switch(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{name} must be true or false")
    return value


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"{name} must be a text")
    return value


def _up_to(most: int) -> Callable[[str, Any], int]:
    def parse_whole(name: str, value: Any) -> int:
        if check.whole(name, value, low=1) > most:
            raise InputError(f"{name} must be at most {most} in a live view, not {value}")
        return int(value)

    return parse_whole


def _fraction(name: str, value: Any) -> float:
    return check.number(name, _number(name, value), low=0.0, high=1.0)


def _pull(name: str, value: Any) -> float | None:
    return None if value is None else check.number(name, _number(name, value), above=0.0, high=MOST_PULL)


def _dtype(name: str, value: Any) -> str:
    if value not in list(DTYPES):
        raise unknown(name, value, DTYPES)
    return str(value)


_CHANGES: dict[str, Callable[[str, Any], Any]] = {
    "method": _text,
    "integrator": _text,
    "substeps": _up_to(MOST_SUBSTEPS),
    "iterations": _up_to(MOST_ITERATIONS),
    "damping": _fraction,
    "stiffness": _fraction,
    "gravity": lambda name, value: _vector(name, value, MOST_GRAVITY),
    "grab_acceleration": _pull,
    "on_failure": _text,
    "max_contacts": _up_to(MOST_CONTACTS),
    "dtype": _dtype,
}


def _changes(changes: Any) -> dict[str, Any]:
    if not isinstance(changes, dict):
        raise InputError(f"changes must be an object with some of {', '.join(_CHANGES)}")
    for name in changes:
        if name not in _CHANGES:
            raise unknown("setting", name, _CHANGES)
    return {name: _CHANGES[name](name, value) for name, value in changes.items()}


def _change(changes: Any) -> Change:
    if not changes:
        raise InputError(f"changes must be an object with some of {', '.join(_CHANGES)}")
    return Change(_changes(changes))


def _open(scene: Any, parameters: Any, changes: Any) -> Open:
    if not isinstance(parameters, dict) or not all(isinstance(value, str) for value in parameters.values()):
        raise InputError("parameters must be an object of texts")
    for name, text in parameters.items():
        try:
            size = abs(float(text))
        except ValueError:
            continue  # a word; the scene says whether it knows it
        if not size <= MOST_OF_A_PARAMETER:
            raise InputError(f"parameter {name} must be at most {MOST_OF_A_PARAMETER} in a live view, not {text}")
    return Open(_text("scene", scene), parameters, _changes(changes))


def _rope(points: Any, pinned: Any) -> Rope:
    if not isinstance(points, list):
        raise InputError("points must be a list")
    places = [list(_vector("a point of the rope", point, FARTHEST)) for point in points]
    return Rope(DrawnRope.from_json({"points": places, "pinned": pinned}))


def _count(name: str, value: Any) -> int:
    return check.whole(name, value, low=0)


_PARSERS: dict[str, tuple[tuple[str, ...], Callable[..., Message]]] = {
    "select": (
        ("particle", "frame", "generation"),
        lambda **given: Select(**{name: _count(name, value) for name, value in given.items()}),
    ),
    "move": (("position",), lambda position: Move(_vector("position", position, FARTHEST))),
    "release": ((), Release),
    "pause": (("on",), lambda on: Pause(_switch("pause", on))),
    "step": ((), Step),
    "reset": ((), Reset),
    "rewind": (("frame",), lambda frame: Rewind(_count("frame", frame))),
    "record": (("on",), lambda on: Record(_switch("record", on))),
    "change": (("changes",), _change),
    "open": (("scene", "parameters", "changes"), _open),
    "rope": (("points", "pinned"), _rope),
    "seen": (("count",), lambda count: Seen(_count("count", count))),
}
