"""pbd-warp study: runs over a grid of parameters, and their plot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from pbd_warp.cli.app import app
from pbd_warp.cli.options import Debug, Device, Dtype, Scheduler, Workers, comma_list, takes_settings
from pbd_warp.cli.terminal import interruptible, one_sentence, tell, warn
from pbd_warp.errors import InputError
from pbd_warp.progress import progress_bar
from pbd_warp.scene import scene_module
from pbd_warp.study.grid import parse_values
from pbd_warp.study.measures import names as measure_names
from pbd_warp.study.plot import plot as draw
from pbd_warp.study.store import load
from pbd_warp.study.study import make_runs, run_study
from pbd_warp.workers import Pool, open_pool


class RunUnlessSaid(TyperGroup):
    """`study SCENE` is `study run SCENE`."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        if args and args[0] not in self.commands and args[0] != "--help":
            args = ["run", *args]
        return super().parse_args(ctx, args)


studies = typer.Typer(cls=RunUnlessSaid, no_args_is_help=True, rich_markup_mode=None)
SUMMARY = "Run a scene over a grid of parameters, a row of measures each. `study SCENE` is `study run SCENE`."
app.add_typer(studies, name="study", short_help=SUMMARY)

EXAMPLES = """Examples:

\b
  pbd-warp study chain --set links=10,20,50 --set method=jacobi,direct --measure max_stretch,energy --out chain.parquet
  pbd-warp study own.py --set mass=0.1:10:log20 --seed 0..99 --measure tip,my_measure --out own.parquet
  pbd-warp study plot chain.parquet --x links --y max_stretch --hue method"""


@studies.callback(help=SUMMARY, epilog=EXAMPLES)
def study() -> None:
    """The group of both commands."""


@studies.command("run", epilog=EXAMPLES)
@takes_settings
def run(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="A scene's name, or your own file.py.")],
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUES",
            help="A parameter of the scene or a setting: 10,20,50, or 0..99, 0:1:lin11, 0.1:10:log20.",
        ),
    ] = None,
    seed: Annotated[str | None, typer.Option(help="Seeds, for scenes with something random in them: 0..99.")] = None,
    measure: Annotated[
        str, typer.Option(help=f"Comma-separated: {', '.join(measure_names())}; or functions of your own file.py.")
    ] = "max_stretch,energy",
    out: Annotated[Path, typer.Option(help="A .parquet file; what is there already is not run again.")] = Path(
        "study.parquet"
    ),
    frames: Annotated[int | None, typer.Option(help="Frames of each run, the initial state included.")] = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    yes: Annotated[bool, typer.Option("--yes", help="Also for a million rows and more.")] = False,
    device: Device = None,
    dtype: Dtype = None,
    debug: Debug = False,
    *,
    changes: dict[str, Any],
) -> None:
    """Run a scene in every combination of what is set, and keep a row of each: settings, measures, outcome."""
    with one_sentence(debug):
        axes: dict[str, str] = {}
        for text in set_ or []:
            name, sign, values = text.partition("=")
            if not sign:
                raise InputError(f"--set {text}: write NAME=VALUES")
            if name in axes:
                raise InputError(f"--set {name} is given twice: write all its values in one")
            axes[name] = values
        seeds = None if seed is None else [int(value) for value in _whole(seed)]
        runs = make_runs(
            scene, axes, _measures(scene, measure), seeds, changes, frames, dtype or "float32", device, yes
        )
        with progress_bar(f"study {Path(scene).stem}") as advance, interruptible() as stop_if_asked:
            rows = run_study(
                runs, out, lambda: open_pool(workers, scheduler), advance, tick=stop_if_asked, on_pool=_tell_dashboard
            )
        outcomes = [row["outcome"] for row in rows.values()]
        counts = ", ".join(f"{outcomes.count(name)} {name}" for name in dict.fromkeys(sorted(outcomes)))
        tell(f"{len(rows)} rows ({counts}): {out}")
        if bad := [number for number in sorted(rows) if rows[number]["outcome"] != "finished"]:
            warn(f"row {bad[0]}, the first that is not finished: {rows[bad[0]]['sentence']}")


@studies.command("plot")
def plot(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What study has written.")],
    x: Annotated[str, typer.Option(help="Column along the axis.")],
    y: Annotated[str, typer.Option(help="Column up.")],
    hue: Annotated[str | None, typer.Option(help="Column whose values have a colour each.")] = None,
    out: Annotated[Path | None, typer.Option(help="FILE with .svg unless given; .svg or .png.")] = None,
    debug: Debug = False,
) -> None:
    """Draw one column of a study against another: the median of what shares x and hue, a band from least to most."""
    with one_sentence(debug):
        picture = out if out is not None else file.with_suffix(".svg")
        draw(load(file), x, y, hue, picture, file.stem)
        tell(str(picture))


def _measures(scene: str, text: str) -> list[Any]:
    """Names, and functions of the scene's own file by theirs."""
    own = vars(scene_module(scene)) if scene.endswith(".py") else {}
    known = measure_names()
    return [own[name] if name not in known and callable(own.get(name)) else name for name in comma_list(text)]


def _whole(text: str) -> list[str]:
    values = parse_values(text)
    if not all(value.isdecimal() for value in values):
        raise InputError(f"--seed must be whole numbers, like 0..99 or 1,2,3, not {text!r}")
    return values


def _tell_dashboard(pool: Pool) -> None:
    if pool.dashboard:
        typer.echo(f"dashboard: {pool.dashboard}", err=True)
