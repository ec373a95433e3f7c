"""Scenes: what to build, and how it is simulated unless one says otherwise."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import pbd_warp.scenes
from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.builder import ModelBuilder
from pbd_warp.step.divergence import Limits
from pbd_warp.step.methods import Jacobi, Method


@dataclass
class Scene:
    """What a scene file's function `scene()` returns.

    builder: The particle graph. frames, fps: Length and rate of the animation. substeps, method, integrator,
    damping, max_contacts, depenetration_speed, limits, on_failure: As in Simulation. drag: The recorded drag, see Drag.
    reference: Exact positions [m] at a time [s], shape [particle_count, 3], where they are known; reference_text: where
    from. name: The file's, filled in by `load_scene`.
    """

    builder: ModelBuilder
    frames: int = 300
    fps: float = 60.0
    substeps: int = 1
    method: Method = field(default_factory=Jacobi)
    integrator: str = "pbd"
    damping: float = 0.0
    max_contacts: int | None = None
    depenetration_speed: float | None = None
    limits: Limits = Limits()  # noqa: RUF009 it is frozen
    on_failure: str = "raise"
    drag: Sequence[Sequence[Any]] = ()
    reference: Callable[[float], np.ndarray] | None = None
    reference_text: str = ""
    name: str = ""


def scene_names() -> list[str]:
    """The scenes that come with the project: every file in scenes/ is one."""
    return sorted(module.name for module in pkgutil.iter_modules(pbd_warp.scenes.__path__))


def scene_summary(name: str) -> str:
    """First line of a scene's docstring."""
    return (_builtin(name).__doc__ or "").strip().splitlines()[0]


def references() -> ModuleType:
    """pbd_warp.accuracy.references, for the scenes that need it; it needs SciPy."""
    try:
        return importlib.import_module("pbd_warp.accuracy.references")
    except ImportError as error:
        raise InputError(f"exact references need SciPy: pip install 'pbd-warp[chart]' ({error})") from None


def load_scene(name: str, seed: int | None = None, settings: Mapping[str, str] | None = None) -> Scene:
    """Build a scene by its name, or from a file of the user's own (anything that ends in .py).

    Args:
        seed: For scenes with something random in them (those whose `scene` takes a seed).
        settings: Values, as text, of other parameters that the scene's function takes.
    """
    module = _from_file(Path(name)) if name.endswith(".py") else _builtin(name)
    build = getattr(module, "scene", None)
    if not callable(build):
        raise InputError(f"scene {name} has no function scene(); it should return a pbd_warp.Scene")
    options = _parse_settings(name, build, settings or {})
    if seed is not None:
        if "seed" not in inspect.signature(build).parameters:
            raise InputError(f"scene {name} has nothing random in it: leave the seed out")
        options["seed"] = check.whole("seed", seed, low=0)
    try:
        scene = build(**options)
    except InputError as error:
        raise InputError(f"scene {name}: {error}") from error
    except Exception as error:
        raise InputError(f"scene {name} fails to build: {_where(error)}") from error
    if not isinstance(scene, Scene):
        raise InputError(f"scene {name}: scene() must return a pbd_warp.Scene, not {type(scene).__name__}")
    scene.name = Path(name).stem
    return scene


def _parse_settings(name: str, build: Callable[..., Any], settings: Mapping[str, str]) -> dict[str, Any]:
    """Each text as the type that the parameter's default has."""
    known = {key: p.default for key, p in inspect.signature(build).parameters.items() if p.default is not p.empty}
    options: dict[str, Any] = {}
    for key, text in settings.items():
        if key not in known:
            raise (
                unknown(f"setting of scene {name}", key, known)
                if known
                else InputError(f"scene {name} has no settings")
            )
        try:
            options[key] = type(known[key])(text)
        except ValueError:
            raise InputError(f"setting {key} of scene {name} must be like {known[key]!r}, not {text!r}") from None
    return options


def _builtin(name: str) -> ModuleType:
    if name not in scene_names():
        raise unknown("scene", name, scene_names())
    return importlib.import_module(f"pbd_warp.scenes.{name}")


def _from_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise InputError(f"there is no scene file {path}")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None  # the name ends in .py
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(f"scene file {path} fails to import: {_where(error)}") from error
    return module


def _where(error: Exception) -> str:
    if isinstance(error, SyntaxError):
        return f"SyntaxError: {error}"  # which says where by itself
    line = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({Path(line.filename).name}, line {line.lineno})"
