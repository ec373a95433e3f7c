"""The command line: pbd-warp list | run | info."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
import warp as wp
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pbd_warp import check
from pbd_warp.cost import cost_sheet
from pbd_warp.errors import InputError, Interrupted, PbdError, unknown
from pbd_warp.methods import METHODS
from pbd_warp.run import RunStats, make_simulation, run
from pbd_warp.scene import Scene, load_scene, scene_names, scene_summary
from pbd_warp.usd import check_folder, check_path

app = typer.Typer(
    help="Position-based dynamics on NVIDIA Warp.", no_args_is_help=True, add_completion=False, rich_markup_mode=None
)

SceneName = Annotated[str, typer.Argument(metavar="SCENE", help="A scene's name, or your own file.py.")]
Frames = Annotated[int | None, typer.Option(help="Frames to write, the initial state included.")]
Fps = Annotated[float | None, typer.Option(help="Frames a second.")]
Device = Annotated[str | None, typer.Option(help="Warp device; Warp's preferred one unless given.")]
Dtype = Annotated[str, typer.Option(help="float32 or float64.")]
Method = Annotated[str | None, typer.Option(help=f"How constraints are projected: {', '.join(METHODS)}.")]
Iterations = Annotated[int | None, typer.Option(help="Solver iterations a substep.")]
Substeps = Annotated[int | None, typer.Option(help="Steps of the loop a frame.")]
Integrator = Annotated[str | None, typer.Option(help="How velocity becomes position and back: pbd.")]
Seed = Annotated[int | None, typer.Option(help="For scenes with something random in them.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show a traceback with an error.")]


@app.command("list")
def list_scenes() -> None:
    """List the scenes."""
    for name in scene_names():
        typer.echo(f"{name:12} {scene_summary(name)}")


@app.command("run")
def run_scene(
    scene: SceneName,
    out: Annotated[Path | None, typer.Option(help="SCENE.usda unless given; .usda, .usdc or .usd.")] = None,
    frames: Frames = None,
    fps: Fps = None,
    device: Device = None,
    dtype: Dtype = "float32",
    method: Method = None,
    iterations: Iterations = None,
    substeps: Substeps = None,
    integrator: Integrator = None,
    seed: Seed = None,
    stats: Annotated[Path | None, typer.Option(help="Write the closing figures to this JSON file.")] = None,
    debug: Debug = False,
) -> None:
    """Simulate a scene and write it as a USD animation."""
    with _one_sentence(debug):
        built = _scene(scene, frames, fps, method, iterations, substeps, integrator, seed)
        path = check_path(out if out is not None else Path(f"{built.name}.usda"))
        if stats is not None:
            check_folder(stats.parent)
        with _progress(built) as advance, _interruptible() as stop_if_asked:
            result = run(built, path, device, dtype, lambda frame: (advance(frame), stop_if_asked()))
        if stats is not None:
            result.save(stats)
        typer.echo(_table(result))


@app.command()
def info(
    scene: SceneName,
    fps: Fps = None,
    device: Device = None,
    dtype: Dtype = "float32",
    method: Method = None,
    iterations: Iterations = None,
    substeps: Substeps = None,
    integrator: Integrator = None,
    seed: Seed = None,
    debug: Debug = False,
) -> None:
    """Show what a frame of a scene costs: passes, launches, memory."""
    with _one_sentence(debug):
        built = _scene(scene, None, fps, method, iterations, substeps, integrator, seed)
        model = built.builder.finalize(device=device, dtype=dtype)
        typer.echo(f"scene            {built.name}, {model.dtype} on {model.device}, {built.method}")
        typer.echo(cost_sheet(make_simulation(built, model)))


def main() -> None:
    """Entry point of the `pbd-warp` command."""
    wp.config.log_level = wp.LOG_ERROR  # the banner and compile times of Warp: ours are in the table
    app()


def _scene(
    name: str,
    frames: int | None,
    fps: float | None,
    method: str | None,
    iterations: int | None,
    substeps: int | None,
    integrator: str | None,
    seed: int | None,
) -> Scene:
    """The scene with what the command line says instead of its own settings."""
    scene = load_scene(name, seed)
    if frames is not None:
        scene.frames = check.whole("frames", frames, low=1)
    if fps is not None:
        scene.fps = check.number("fps", fps, above=0.0)
    if substeps is not None:
        scene.substeps = substeps
    if integrator is not None:
        scene.integrator = integrator
    options: dict[str, Any] = {} if iterations is None else {"iterations": iterations}
    if method is not None:
        if method not in METHODS:
            raise unknown("method", method, METHODS)
        if METHODS[method] is not type(scene.method):
            scene.method = METHODS[method](**options)
    if options:
        scene.method = type(scene.method)(**{**vars(scene.method), **options})
    return scene


@contextmanager
def _one_sentence(debug: bool) -> Iterator[None]:
    """Errors become one sentence on stderr and an exit code: 2 bad usage, 1 the run failed, 130 Ctrl-C."""
    try:
        yield
    except (PbdError, OSError) as error:
        if debug:
            traceback.print_exc()
        typer.echo(f"pbd-warp: {error}", err=True)
        code = 2 if isinstance(error, InputError) else 130 if isinstance(error, Interrupted) else 1
        raise typer.Exit(code) from None


@contextmanager
def _progress(scene: Scene) -> Iterator[Callable[[int], None]]:
    """A progress bar on a terminal, nothing in a pipe."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(scene.name, total=scene.frames)
        yield lambda frame: progress.update(task, completed=frame + 1)


@contextmanager
def _interruptible() -> Iterator[Callable[[], None]]:
    """Ctrl-C is noted, and acted on where the function that this gives is called: between two frames.

    Python would raise it wherever it happens to be, and drop it where that is a destructor. A second Ctrl-C does.
    """
    asked: list[int] = []
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: object) -> None:
        asked.append(number)
        signal.signal(signal.SIGINT, before)

    def stop_if_asked() -> None:
        if asked:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield stop_if_asked
    finally:
        signal.signal(signal.SIGINT, before)


def _table(stats: RunStats) -> str:
    size = Path(stats.out).stat().st_size
    rows = {
        "scene": f"{stats.scene}, {stats.particles} particles, {stats.constraints} constraints",
        "frames": f"{stats.frames} at {stats.wall_ms_per_frame:.3f} ms a frame",
        "compile": f"{stats.compile_s:.2f} s",
        "max stretch": f"{100 * stats.max_stretch:.3g} %",
        "max residual": f"{stats.max_residual:.3g} m",
        "energy": f"{stats.energy_start:.6g} J at the start, {stats.energy_end:.6g} J at the end",
        "file": f"{stats.out}, {size / 1024:.0f} KiB",
    }
    return "\n".join(f"{name:13} {value}" for name, value in rows.items())
