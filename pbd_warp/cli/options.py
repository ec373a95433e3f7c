"""Options that several commands share, one vocabulary everywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.retry import ON_FAILURE
from pbd_warp.scene import Scene, load_scene
from pbd_warp.step.integrators import INTEGRATORS
from pbd_warp.step.methods import METHODS

SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="A scene's name, or your own file.py.")]
Frames = Annotated[int | None, typer.Option(help="Frames to write, the initial state included.")]
Fps = Annotated[float | None, typer.Option(help="Frames a second.")]
Device = Annotated[str | None, typer.Option(help="Warp device; Warp's preferred one unless given.")]
Dtype = Annotated[str | None, typer.Option(help="float32 (unless given) or float64.")]
Method = Annotated[str | None, typer.Option(help=f"How constraints are projected: {', '.join(METHODS)}.")]
Iterations = Annotated[int | None, typer.Option(help="Solver iterations a substep.")]
Substeps = Annotated[int | None, typer.Option(help="Steps of the loop a frame.")]
Tolerance = Annotated[float | None, typer.Option(help="Stop iterating when the largest |C| is below [m].")]
Integrator = Annotated[
    str | None, typer.Option(help=f"How velocity becomes position and back: {', '.join(INTEGRATORS)}.")
]
OnFailure = Annotated[str | None, typer.Option(help=f"What becomes of a frame that fails: {', '.join(ON_FAILURE)}.")]
Checkpoint = Annotated[Path | None, typer.Option(help="Leave in this file what is needed to go on.")]
Every = Annotated[int, typer.Option(help="Frames from checkpoint to checkpoint.")]
Resume = Annotated[bool, typer.Option("--resume", help="Go on from the checkpoint.")]
Set = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A setting of the scene.")]
Seed = Annotated[int | None, typer.Option(help="For scenes with something random in them.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show a traceback with an error.")]


def scene_with(
    name: str,
    frames: int | None,
    fps: float | None,
    method: str | None,
    iterations: int | None,
    substeps: int | None,
    integrator: str | None,
    tolerance: float | None,
    seed: int | None,
    settings: list[str] | None,
) -> Scene:
    """The scene with what the command line says instead of its own settings."""
    for text in settings or []:
        if "=" not in text:
            raise InputError(f"--set {text}: write NAME=VALUE")
    scene = load_scene(name, seed, dict(text.split("=", 1) for text in settings or []))
    return override(scene, frames, fps, method, iterations, substeps, integrator, tolerance)


def override(
    scene: Scene,
    frames: int | None,
    fps: float | None,
    method: str | None,
    iterations: int | None,
    substeps: int | None,
    integrator: str | None,
    tolerance: float | None,
) -> Scene:
    """A scene with what the command line says instead of its own settings."""
    if frames is not None:
        scene.frames = check.whole("frames", frames, low=1)
    if fps is not None:
        scene.fps = check.number("fps", fps, above=0.0)
    if substeps is not None:
        scene.substeps = substeps
    if integrator is not None:
        scene.integrator = integrator
    options: dict[str, Any] = {} if iterations is None else {"iterations": iterations}
    if tolerance is not None:
        options["tolerance"] = tolerance
    if method is not None:
        if method not in METHODS:
            raise unknown("method", method, METHODS)
        if METHODS[method] is not type(scene.method):
            scene.method = METHODS[method](**options)
    if options:
        scene.method = type(scene.method)(**{**vars(scene.method), **options})
    return scene


def comma_list(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def whole_list(name: str, text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in comma_list(text))
    except ValueError:
        raise InputError(f"--{name} must be whole numbers separated by commas, not {text!r}") from None
