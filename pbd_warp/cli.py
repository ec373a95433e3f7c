"""The command line: pbd-warp list | run | info | chart."""

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
from pbd_warp.chart import Chart, Row, flags, front, load, save
from pbd_warp.chart import pick as pick_row
from pbd_warp.cost import cost_sheet
from pbd_warp.errors import InputError, Interrupted, PbdError, unknown
from pbd_warp.integrators import INTEGRATORS
from pbd_warp.methods import METHODS
from pbd_warp.picture import check_picture, draw
from pbd_warp.run import RunStats, make_simulation, run
from pbd_warp.scene import Scene, load_scene, scene_names, scene_summary
from pbd_warp.sweep import Sweep, charts_folder, sweep_scene
from pbd_warp.usd import check_path

app = typer.Typer(
    help="Position-based dynamics on NVIDIA Warp.", no_args_is_help=True, add_completion=False, rich_markup_mode=None
)

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
Set = Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A setting of the scene.")]
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
    dtype: Dtype = None,
    method: Method = None,
    iterations: Iterations = None,
    substeps: Substeps = None,
    integrator: Integrator = None,
    tolerance: Tolerance = None,
    seed: Seed = None,
    set_: Set = None,
    accuracy: Annotated[
        float | None, typer.Option(help="Take the fastest settings that the scene's chart has within this error [m].")
    ] = None,
    stats: Annotated[Path | None, typer.Option(help="Write the closing figures to this JSON file.")] = None,
    debug: Debug = False,
) -> None:
    """Simulate a scene and write it as a USD animation."""
    with _one_sentence(debug):
        built = _scene(scene, frames, fps, method, iterations, substeps, integrator, tolerance, seed, set_)
        if accuracy is not None:
            if any(given is not None for given in (method, iterations, substeps, integrator)) or dtype is not None:
                raise InputError(
                    "--accuracy chooses method, iterations, substeps, integrator and dtype: leave those out"
                )
            row = pick_for(built, accuracy)
            dtype = row.dtype
            typer.echo(f"--accuracy {accuracy:g}: {flags(row)} (error {row.position_error:.2g} m on the chart)")
        path = check_path(out if out is not None else Path(f"{built.name}.usda"))
        if stats is not None:
            check.folder(stats.parent)
        with _bar(built.name) as advance, _interruptible() as stop_if_asked:
            result = run(
                built, path, device, dtype or "float32", lambda done: (advance(done, built.frames), stop_if_asked())
            )
        if stats is not None:
            result.save(stats)
        typer.echo(_table(result))


@app.command()
def info(
    scene: SceneName,
    fps: Fps = None,
    device: Device = None,
    dtype: Dtype = None,
    method: Method = None,
    iterations: Iterations = None,
    substeps: Substeps = None,
    integrator: Integrator = None,
    tolerance: Tolerance = None,
    seed: Seed = None,
    set_: Set = None,
    debug: Debug = False,
) -> None:
    """Show what a frame of a scene costs: passes, launches, memory."""
    with _one_sentence(debug):
        built = _scene(scene, None, fps, method, iterations, substeps, integrator, tolerance, seed, set_)
        model = built.builder.finalize(device=device, dtype=dtype or "float32")
        typer.echo(f"scene            {built.name}, {model.dtype} on {model.device}, {built.method}")
        typer.echo(cost_sheet(make_simulation(built, model)))


@app.command()
def chart(
    scene: Annotated[str | None, typer.Argument(metavar="SCENE", help="A scene's name, or your own file.py.")] = None,
    out: Annotated[Path | None, typer.Option(help="SCENE.svg unless given; .svg or .png.")] = None,
    csv: Annotated[Path | None, typer.Option(help="The numbers; OUT with .csv unless given.")] = None,
    from_csv: Annotated[Path | None, typer.Option(help="Draw these numbers, measure nothing.")] = None,
    pick: Annotated[
        float | None, typer.Option(help="Print the cheapest settings within this error [m], as flags for run.")
    ] = None,
    methods: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(Sweep.methods),
    integrators: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(Sweep.integrators),
    substeps: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(map(str, Sweep.substeps)),
    iterations: Annotated[str, typer.Option(help="Comma-separated; not for direct.")] = ",".join(
        map(str, Sweep.iterations)
    ),
    dtypes: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(Sweep.dtypes),
    repeat: Annotated[int, typer.Option(help="Timed repetitions.")] = Sweep.repeat,
    device: Device = None,
    fps: Fps = None,
    seed: Seed = None,
    set_: Set = None,
    debug: Debug = False,
) -> None:
    """Chart speed against accuracy for a scene: measure it under many settings, draw error against time."""
    with _one_sentence(debug):
        if (scene is None) == (from_csv is None):
            raise InputError("chart needs a scene to measure or --from-csv FILE to draw, and not both")
        name = Path(scene or str(from_csv)).stem
        picture = out if out is not None else Path(f"{name}.svg")
        check_picture(picture)
        if from_csv is not None:
            made = load(from_csv)
        else:
            assert scene is not None
            sweep = Sweep(
                _list(methods), _list(integrators), _whole("substeps", substeps), _whole("iterations", iterations),
                _list(dtypes), repeat,
            )  # fmt: skip
            built = _scene(scene, None, fps, None, None, None, None, None, seed, set_)
            numbers = csv if csv is not None else picture.with_suffix(".csv")
            check.folder(numbers.parent)
            with _bar(f"chart {built.name}") as advance, _interruptible() as stop_if_asked:
                made = sweep_scene(built, sweep, device, lambda done, of: (advance(done, of), stop_if_asked()))
            save(made, numbers)
        draw(made, picture)
        typer.echo(f"{len(made.rows)} configurations, {len(front(made.rows))} on the front: {picture}")
        if pick is not None:
            row = pick_row(made.rows, check.number("--pick", pick, above=0.0))
            if row is None:
                raise InputError(f"no measured configuration is within {pick:g} m; the best is {_best(made):.2g} m")
            typer.echo(flags(row))


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
    tolerance: float | None,
    seed: int | None,
    settings: list[str] | None,
) -> Scene:
    """The scene with what the command line says instead of its own settings."""
    for text in settings or []:
        if "=" not in text:
            raise InputError(f"--set {text}: write NAME=VALUE")
    scene = load_scene(name, seed, dict(text.split("=", 1) for text in settings or []))
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
def _bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on a terminal, nothing in a pipe; gives a function of how many are done, of how many."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, of: progress.update(task, completed=done, total=of)


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


def pick_for(scene: Scene, accuracy: float) -> Row:
    """The fastest settings within an error on the chart that comes with the project, set on the scene."""
    path = charts_folder() / f"{scene.name}.csv"
    if not path.is_file():
        raise InputError(f"there is no chart of scene {scene.name}: make one with pbd-warp chart, and use its --pick")
    made = load(path)
    row = pick_row(made.rows, check.number("--accuracy", accuracy, above=0.0))
    if row is None:
        raise InputError(
            f"no settings on the chart of scene {scene.name} are within {accuracy:g} m; best: {_best(made):.2g} m"
        )
    scene.method = METHODS[row.method](iterations=row.iterations)
    scene.integrator, scene.substeps = row.integrator, row.substeps
    return row


def _best(made: Chart) -> float:
    return min((row.position_error for row in front(made.rows)), default=float("inf"))


def _list(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _whole(name: str, text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in _list(text))
    except ValueError:
        raise InputError(f"--{name} must be whole numbers separated by commas, not {text!r}") from None


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
    if stats.unconverged is not None:
        rows["converged"] = f"all but {stats.unconverged} steps" if stats.unconverged else "every step"
    return "\n".join(f"{name:13} {value}" for name, value in rows.items())
