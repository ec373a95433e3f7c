"""What a page may say. Everything is checked here: what comes out makes sense, or is an InputError."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.grab.camera import Camera

LARGEST = 4096
"""Characters of a message."""

MOST_SUBSTEPS, MOST_ITERATIONS = 512, 512
MOST_GRAVITY = 1000.0  # m/s^2


@dataclass(frozen=True)
class Click:
    """A button pressed and released at a place on the screen [px]: select, or let go."""

    camera: Camera
    at: tuple[float, float]


@dataclass(frozen=True)
class Move:
    """The cursor is at a place on the screen [px]."""

    camera: Camera
    at: tuple[float, float]


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
class Change:
    """Other settings: arguments of `Settings.changed`."""

    changes: Mapping[str, Any]


@dataclass(frozen=True)
class Load:
    """Another scene, or the present one as it was at first."""

    scene: str


@dataclass(frozen=True)
class Seen:
    """So many frames has the page received."""

    count: int


Message = Click | Move | Release | Pause | Step | Reset | Change | Load | Seen


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
    return make(*(data[field] for field in fields))


def _camera(data: Any) -> Camera:
    names = ("eye", "forward", "up", "field_of_view", "size")
    if not isinstance(data, dict) or set(data) != set(names):
        raise InputError(f"camera must have {', '.join(names)}")
    eye, forward, up = (_numbers(f"camera: {name}", data[name], 3) for name in names[:3])
    return Camera(
        *(eye, forward, up), _number("camera: field_of_view", data["field_of_view"]), _numbers("size", data["size"], 2)
    )


def _number(name: str, value: Any) -> float:
    """A number that is written as one: neither a text nor true or false."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{name} must be a number")
    return check.number(name, value)


def _numbers(name: str, values: Any, count: int) -> list[float]:
    if not isinstance(values, list) or len(values) != count:
        raise InputError(f"{name} must be {count} numbers")
    return [_number(name, value) for value in values]


def _at(camera: Any, at: Any) -> tuple[Camera, tuple[float, float]]:
    seen_by = _camera(camera)
    x, y = seen_by.place(_numbers("at", at, 2)).tolist()
    return seen_by, (x, y)


def _pause(on: Any) -> Pause:
    if not isinstance(on, bool):
        raise InputError("pause must be true or false")
    return Pause(on)


def _load(scene: Any) -> Load:
    if not isinstance(scene, str):
        raise InputError("scene must be a text")
    return Load(scene)


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


def _part(name: str, value: Any) -> float:
    return check.number(name, _number(name, value), low=0.0, high=1.0)


def _gravity(name: str, value: Any) -> tuple[float, float, float]:
    x, y, z = (check.number(name, c, low=-MOST_GRAVITY, high=MOST_GRAVITY) for c in _numbers(name, value, 3))
    return x, y, z


_CHANGES: dict[str, Callable[[str, Any], Any]] = {
    "method": _text,
    "integrator": _text,
    "substeps": _up_to(MOST_SUBSTEPS),
    "iterations": _up_to(MOST_ITERATIONS),
    "damping": _part,
    "stiffness": _part,
    "gravity": _gravity,
}


def _change(changes: Any) -> Change:
    if not isinstance(changes, dict) or not changes:
        raise InputError(f"changes must be an object with some of {', '.join(_CHANGES)}")
    for name in changes:
        if name not in _CHANGES:
            raise unknown("setting", name, _CHANGES)
    return Change({name: _CHANGES[name](name, value) for name, value in changes.items()})


_PARSERS: dict[str, tuple[tuple[str, ...], Callable[..., Message]]] = {
    "click": (("camera", "at"), lambda camera, at: Click(*_at(camera, at))),
    "move": (("camera", "at"), lambda camera, at: Move(*_at(camera, at))),
    "release": ((), Release),
    "pause": (("on",), _pause),
    "step": ((), Step),
    "reset": ((), Reset),
    "change": (("changes",), _change),
    "load": (("scene",), _load),
    "seen": (("count",), lambda count: Seen(check.whole("count", count, low=0))),
}
