"""Scenes: what to build, and how it is simulated unless one says otherwise."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import pkgutil
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

import pbd_warp.scenes
from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.builder import ModelBuilder
from pbd_warp.settings import Settings, frame_length


@dataclass(frozen=True, init=False)
class Scene:
    """What a scene file's function `scene()` returns.

    builder: The particle graph. frames: Length of the animation. settings: How it is simulated.
    drag: The recorded drag, see Drag.
    reference: Exact positions [m] at a time [s], shape [particle_count, 3], where they are known; reference_text: where
    from. name: The file's, filled in by `load_scene`.

    Settings may also be given by their names, with `fps` for 1 / dt: Scene(builder, fps=24, damping=0.1).

    Raises:
        InputError: a setting that makes no sense.
    """

    builder: ModelBuilder
    frames: int
    settings: Settings
    drag: Sequence[Sequence[Any]]
    reference: Callable[[float], np.ndarray] | None
    reference_text: str
    name: str

    def __init__(
        self,
        builder: ModelBuilder,
        frames: int = 300,
        *,
        settings: Settings | None = None,
        fps: float | None = None,
        drag: Sequence[Sequence[Any]] = (),
        reference: Callable[[float], np.ndarray] | None = None,
        reference_text: str = "",
        name: str = "",
        **changes: Any,
    ):
        if fps is not None:
            changes["dt"] = frame_length("fps", fps)
        values = {
            "builder": builder,
            "frames": frames,
            "settings": (settings or Settings()).changed(**changes),
            "drag": drag,
            "reference": reference,
            "reference_text": reference_text,
            "name": name,
        }
        for field, value in values.items():
            object.__setattr__(self, field, value)

    @property
    def fps(self) -> float:
        """Frames a second."""
        return self.settings.fps

    def changed(self, **changes: Any) -> Scene:
        """This scene with other fields or settings, by name."""
        own = {field.name: getattr(self, field.name) for field in fields(self)}
        return Scene(**{**own, **changes})

    def __repr__(self) -> str:
        return f"Scene({self.name!r}, {self.builder!r}, {self.frames} frames at {self.fps:g} a second, {self.settings})"


def scene_names() -> list[str]:
    """The scenes that come with the project: every file in scenes/ is one."""
    return sorted(module.name for module in pkgutil.iter_modules(pbd_warp.scenes.__path__))


def scene_summary(name: str) -> str:
    """First line of a scene's docstring."""
    return (_builtin(name).__doc__ or "").strip().splitlines()[0]


def scene_parameters(name: str) -> dict[str, Any]:
    """The parameters of a scene that can be set, each with its default; by the scene's name, or from a file of the
    user's own."""
    return defaults_of(getattr(scene_module(name), "scene", None))


def scene_text(name: str) -> str:
    """What a scene says of its parameters: the docstring of its function, in one line."""
    build = getattr(scene_module(name), "scene", None)
    return " ".join((inspect.getdoc(build) or "").split()) if callable(build) else ""


def parameters_text(name: str) -> str:
    """A scene's parameters with their defaults, as --set takes them; empty where it has none."""
    return " ".join(f"{parameter}={value}" for parameter, value in scene_parameters(name).items())


def references() -> ModuleType:
    """pbd_warp.accuracy.references, for the scenes that need it; it needs SciPy."""
    try:
        return importlib.import_module("pbd_warp.accuracy.references")
    except ImportError as error:
        raise InputError(f"exact references need SciPy: pip install 'pbd-warp[chart]' ({error})") from None


def load_scene(name: str, seed: int | None = None, parameters: Mapping[str, str] | None = None) -> Scene:
    """Build a scene by its name, or from a file of the user's own (anything that ends in .py).

    Args:
        seed: For scenes with something random in them (those whose `scene` takes a seed).
        parameters: Values, as text, of other parameters that the scene's function takes.
    """
    build = scene_function(name)
    options = parse_parameters(name, build, parameters or {})
    if seed is not None:
        options["seed"] = check_seed(name, build, seed)
    return build_scene(name, build, options)


def scene_function(name: str) -> Callable[..., Scene]:
    """The function that builds a scene, by its name or from a file of the user's own."""
    build = getattr(scene_module(name), "scene", None)
    if not callable(build):
        raise InputError(f"scene {name} has no function scene(); it should return a pbd_warp.Scene")
    function: Callable[..., Scene] = build
    return function


def build_scene(name: str, build: Callable[..., Scene], options: Mapping[str, Any]) -> Scene:
    """What the function makes of its parameters; what goes wrong in it is an InputError."""
    try:
        scene = build(**options)
    except InputError as error:
        raise InputError(f"scene {name}: {error}") from error
    except Exception as error:
        raise InputError(f"scene {name} fails to build: {_where(error)}") from error
    if not isinstance(scene, Scene):
        raise InputError(f"scene {name}: scene() must return a pbd_warp.Scene, not {type(scene).__name__}")
    return scene.changed(name=Path(name).stem)


def check_seed(name: str, build: Callable[..., Scene], seed: int) -> int:
    """The seed, for a scene that takes one."""
    if "seed" not in inspect.signature(build).parameters:
        raise InputError(f"scene {name} has nothing random in it: leave the seed out")
    return check.whole("seed", seed, low=0)


def parse_parameters(name: str, build: Callable[..., Any], parameters: Mapping[str, str]) -> dict[str, Any]:
    """Each text as the type that the parameter's default has."""
    known = defaults_of(build)
    options: dict[str, Any] = {}
    for key, text in parameters.items():
        if key not in known:
            raise (
                unknown(f"parameter of scene {name}", key, known)
                if known
                else InputError(f"scene {name} has no parameters")
            )
        try:
            options[key] = _switch(text) if isinstance(known[key], bool) else type(known[key])(text)
        except (TypeError, ValueError):
            raise InputError(f"parameter {key} of scene {name} must be like {known[key]!r}, not {text!r}") from None
    return options


def defaults_of(build: Any) -> dict[str, Any]:
    """The parameters of a function that have a default, with it."""
    if not callable(build):
        return {}
    return {key: p.default for key, p in inspect.signature(build).parameters.items() if p.default is not p.empty}


def _switch(text: str) -> bool:
    return {"true": True, "false": False}[text.lower()] if text.lower() in ("true", "false") else bool(int(text))


def scene_module(name: str) -> ModuleType:
    """What a scene comes from, by its name or its file."""
    return _from_file(Path(name)) if name.endswith(".py") else _builtin(name)


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
