"""Settings as pages see and change them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.grab.recording import interactive
from pbd_warp.model.builder import DTYPES
from pbd_warp.settings import Settings
from pbd_warp.step.methods import Direct
from pbd_warp.view import values

GRAB_ACCELERATION = 100.0
"""Of a scene that has none [m/s^2]: ten times its weight. At twice as much the rope scene stretches by 2 %."""

MOST_GRAVITY = 1000.0  # m/s^2
MOST_PULL = 1e6  # m/s^2

MOST_SWEEPS = 8192
"""Substeps times iterations. Above, a change of settings takes seconds: a frame is captured launch by launch."""


def _pull(name: str, value: Any) -> float | None:
    return None if value is None else check.number(name, values.number(name, value), above=0.0, high=MOST_PULL)


CHANGES: dict[str, Callable[[str, Any], Any]] = {
    "method": values.text,
    "integrator": values.text,
    "substeps": values.up_to(512),
    "iterations": values.up_to(512),
    "damping": values.fraction,
    "stiffness": values.fraction,
    "gravity": lambda name, value: values.vector(name, value, MOST_GRAVITY),
    "grab_acceleration": _pull,
    "on_failure": values.text,
    "max_contacts": values.up_to(1_000_000),
    "dtype": values.one_of(tuple(DTYPES)),
}
"""What a page may change, and how it is checked: settings, options of the method, and the precision."""


def parse_changes(changes: Any) -> dict[str, Any]:
    """Changes that a page asks for; an InputError for what is none."""
    if not isinstance(changes, dict):
        raise InputError(f"changes must be an object with some of {', '.join(CHANGES)}")
    for name in changes:
        if name not in CHANGES:
            raise unknown("setting", name, CHANGES)
    return {name: CHANGES[name](name, value) for name, value in changes.items()}


def in_force(settings: Settings) -> dict[str, Any]:
    """The values of settings by the names under which they are changed."""
    method = settings.method
    return {**vars(settings), "method": method.name, "iterations": method.iterations}


def pulling(settings: Settings) -> Settings:
    """The settings of a scene that a mouse drags."""
    settings = interactive(settings)
    return settings if settings.grab_acceleration else settings.changed(grab_acceleration=GRAB_ACCELERATION)


def changed(
    now: Settings, scene: Settings, *, method: str | None = None, iterations: int | None = None, **others: Any
) -> Settings:
    """Settings with others in their place: `method` by its name, its `iterations`, and any other.

    The scene's own method comes as the scene has it. Another one begins with its defaults, but keeps the number of
    iterations, unless one of the two is `Direct`, to which the number is only a limit.

    Raises:
        InputError: what a setting refuses, or is too much for a live view.
    """
    new = now.changed(**others)
    if method is not None and method != now.method.name:
        if method == scene.method.name:
            new = new.changed(method=scene.method)
        elif Direct.name in (method, now.method.name):
            new = new.with_method(method)
        else:
            new = new.with_method(method, iterations=now.method.iterations)
    if iterations is not None:
        new = new.with_method(iterations=iterations)
    sweeps = new.steps_a_frame * new.method.iterations
    if sweeps > MOST_SWEEPS and (new.substeps, new.method.iterations) != (now.substeps, now.method.iterations):
        raise InputError(
            f"{new.substeps} substeps of {new.method.iterations} iterations are too much for a live view; "
            f"their product must be at most {MOST_SWEEPS}"
        )
    return new
