"""Options that several commands share, one vocabulary everywhere; those of `Settings` are derived from it."""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.scene import Scene, load_scene
from pbd_warp.settings import Settings
from pbd_warp.step.methods import METHODS

SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="A scene's name, or your own file.py.")]
Frames = Annotated[int | None, typer.Option(help="Frames to write, the initial state included.")]
Device = Annotated[str | None, typer.Option(help="Warp device; Warp's preferred one unless given.")]


def _not_empty(value: str | None) -> str | None:
    if value == "":
        raise typer.BadParameter("it is empty")
    return value


Dtype = Annotated[str | None, typer.Option(help="float32 (unless given) or float64.", callback=_not_empty)]
Checkpoint = Annotated[Path | None, typer.Option(help="Leave in this file what is needed to go on.")]
Every = Annotated[int, typer.Option(help="Frames from checkpoint to checkpoint.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint.")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the scene.")]
Seed = Annotated[int | None, typer.Option(help="For scenes with something random in them.")]
Tension = Annotated[
    bool, typer.Option("--tension", help="Write primvars:tension of the curves [N] too; method direct knows it.")
]
Workers = Annotated[
    int | None, typer.Option(help="Processes that share the work; as many as there are cores unless given.")
]
Scheduler = Annotated[str | None, typer.Option(help="Address of a Dask scheduler, whose workers do the work instead.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show a traceback with an error.")]


def _help(name: str) -> str:
    """The first sentence on a field in the docstring of `Settings`."""
    assert Settings.__doc__ is not None
    found = re.search(rf"^    {name}: (.*?[.:])(?=\s|$)", Settings.__doc__, re.MULTILINE | re.DOTALL)
    assert found is not None, f"Settings does not say what {name} is"
    return " ".join(found[1].rstrip(":").split())


OF_ONE_WORD = (int, float, str, int | None, float | None)
OF_PYTHON = ("dt", "stiffness")
"""Settings that the command line says otherwise: --fps, and scenes by their own stiffness."""

SETTINGS = {
    "fps": Annotated[float | None, typer.Option(help="Frames a second.")],
    "method": Annotated[str | None, typer.Option(help=f"How constraints are projected: {', '.join(METHODS)}.")],
    "iterations": Annotated[int | None, typer.Option(help="Of the method: iterations a substep.")],
    "tolerance": Annotated[float | None, typer.Option(help="Of the method: stop when the largest |C| is below [m].")],
    "substeps": Annotated[str | None, typer.Option(metavar="NUMBER|auto", help=_help("substeps"))],
} | {
    name: Annotated[hint | None, typer.Option(help=_help(name))]
    for name, hint in get_type_hints(Settings).items()
    if hint in OF_ONE_WORD and name not in OF_PYTHON
}
"""By name of the option: what may be said of the settings of a scene."""


def takes_settings(command: Callable[..., None]) -> Callable[..., None]:
    """Decorator: a command with the options of SETTINGS, which it gets as one mapping, `changes`, of those given."""
    signature = inspect.signature(command, eval_str=True)
    own = [p for p in signature.parameters.values() if p.name != "changes"]
    options = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
        for name, annotation in SETTINGS.items()
        if name not in signature.parameters
    ]

    @functools.wraps(command)
    def with_changes(**given: Any) -> None:
        changes = {option.name: given.pop(option.name) for option in options}
        command(**given, changes={name: value for name, value in changes.items() if value is not None})

    keywords = [p.replace(kind=inspect.Parameter.KEYWORD_ONLY) for p in own]
    with_changes.__signature__ = inspect.Signature([*keywords, *options])  # type: ignore[attr-defined]
    with_changes.__annotations__ = {p.name: p.annotation for p in (*keywords, *options)}
    return with_changes


def parameters_of(set_: Sequence[str] | None) -> dict[str, str]:
    """What --set says, by name."""
    for text in set_ or []:
        if "=" not in text:
            raise InputError(f"--set {text}: write NAME=VALUE")
    return dict(text.split("=", 1) for text in set_ or [])


def scene_with(
    name: str, changes: Mapping[str, Any], seed: int | None, set_: Sequence[str] | None, frames: int | None = None
) -> Scene:
    """The scene with what the command line says instead of its own settings."""
    scene = load_scene(name, seed, parameters_of(set_))
    if frames is not None:
        scene = scene.changed(frames=check.whole("frames", frames, low=1))
    return scene.changed(settings=scene.settings.with_options(changes))


def scene_file(name: str) -> list[Path]:
    """The user's own file that a scene is read from, if it is one."""
    return [Path(name)] if name.endswith(".py") else []


def comma_list(text: str) -> tuple[str, ...]:
    return tuple(item.strip() for item in text.split(",") if item.strip())


def whole_list(name: str, text: str) -> tuple[int, ...]:
    try:
        return tuple(int(item) for item in comma_list(text))
    except ValueError:
        raise InputError(f"--{name} must be whole numbers separated by commas, not {text!r}") from None


def number_list(name: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(float(item) for item in comma_list(text))
    except ValueError:
        raise InputError(f"--{name} must be numbers separated by commas, not {text!r}") from None
