"""How a page changes settings."""

from __future__ import annotations

from typing import Any

from pbd_warp.errors import InputError
from pbd_warp.grab.recording import interactive
from pbd_warp.settings import Settings
from pbd_warp.step.methods import Direct

GRAB_ACCELERATION = 100.0
"""Of a scene that has none [m/s^2]: ten times its weight. At twice as much the rope scene stretches by 2 %."""

MOST_SWEEPS = 8192
"""Substeps times iterations. Above, a change of settings takes seconds: a frame is captured launch by launch."""


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
    sweeps = new.substeps * new.method.iterations
    if sweeps > MOST_SWEEPS and (new.substeps, new.method.iterations) != (now.substeps, now.method.iterations):
        raise InputError(
            f"{new.substeps} substeps of {new.method.iterations} iterations are too much for a live view; "
            f"their product must be at most {MOST_SWEEPS}"
        )
    return new
