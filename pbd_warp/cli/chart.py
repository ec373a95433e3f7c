"""pbd-warp chart."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pbd_warp import check
from pbd_warp.accuracy.chart import best_error, flags, front, load, save
from pbd_warp.accuracy.chart import pick as pick_row
from pbd_warp.accuracy.peers import load as load_peers
from pbd_warp.accuracy.plot import check_picture, draw
from pbd_warp.accuracy.sweep import Sweep, sweep_scene
from pbd_warp.cli.app import command
from pbd_warp.cli.options import (
    Debug,
    Device,
    Scheduler,
    Seed,
    Set,
    Workers,
    comma_list,
    number_list,
    scene_file,
    scene_with,
    whole_list,
)
from pbd_warp.cli.terminal import interruptible, one_sentence, tell
from pbd_warp.errors import InputError
from pbd_warp.paths import check_apart, check_file
from pbd_warp.progress import progress_bar
from pbd_warp.workers import open_some


@command("chart", "chart my_scene.py", "chart rope --methods direct,jacobi --pick 1e-3")
def chart(
    scene: Annotated[str | None, typer.Argument(metavar="SCENE", help="A scene's name, or your own file.py.")] = None,
    out: Annotated[Path | None, typer.Option(help="SCENE.svg unless given; .svg or .png.")] = None,
    csv: Annotated[Path | None, typer.Option(help="The numbers; OUT with .csv unless given.")] = None,
    from_csv: Annotated[Path | None, typer.Option(help="Draw these numbers, measure nothing.")] = None,
    peers: Annotated[
        Path | None, typer.Option(help="Draw other simulators' lines from this CSV of benchmarks/peers.py.")
    ] = None,
    pick: Annotated[
        float | None, typer.Option(help="Print the cheapest settings within this error [m], as flags for run.")
    ] = None,
    methods: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(Sweep.methods),
    integrators: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(Sweep.integrators),
    substeps: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(map(str, Sweep.substeps)),
    iterations: Annotated[str, typer.Option(help="Comma-separated; not for direct.")] = ",".join(
        map(str, Sweep.iterations)
    ),
    errors: Annotated[str, typer.Option(help="Of dop853 [m/s], comma-separated.")] = ",".join(
        f"{error:g}" for error in Sweep.errors
    ),
    dtypes: Annotated[str, typer.Option(help="Comma-separated.")] = ",".join(Sweep.dtypes),
    repeat: Annotated[int, typer.Option(help="Timed repetitions.")] = Sweep.repeat,
    device: Device = None,
    fps: Annotated[float | None, typer.Option(help="Frames a second.")] = None,
    seed: Seed = None,
    set_: Set = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
    debug: Debug = False,
) -> None:
    """Chart speed against accuracy for a scene: measure it under many settings, draw error against time."""
    with one_sentence(debug):
        if (scene is None) == (from_csv is None):
            raise InputError("chart needs a scene to measure or --from-csv FILE to draw, and not both")
        name = Path(scene or str(from_csv)).stem
        picture = out if out is not None else Path(f"{name}.svg")
        check_picture(picture)
        others = load_peers(peers)[0] if peers is not None else ()
        reads = {"--peers": [peers]} if peers is not None else {}
        if from_csv is not None:
            check_apart({"--from-csv": [from_csv], **reads}, {"--out": [picture]})
            made = load(from_csv)
        else:
            assert scene is not None
            sweep = Sweep(
                comma_list(methods),
                comma_list(integrators),
                whole_list("substeps", substeps),
                whole_list("iterations", iterations),
                number_list("errors", errors),
                comma_list(dtypes),
                repeat,
            )
            built = scene_with(scene, {"fps": fps} if fps is not None else {}, seed, set_)
            numbers = csv if csv is not None else picture.with_suffix(".csv")
            check_apart({"the scene": scene_file(scene), **reads}, {"--out": [picture], "--csv": [check_file(numbers)]})
            with (
                progress_bar(f"chart {built.name}") as advance,
                interruptible() as stop_if_asked,
                open_some(workers, scheduler) as pool,
            ):
                made = sweep_scene(built, sweep, device, advance, pool, stop_if_asked)
            save(made, numbers)
        scenes = {row.scene for row in made.rows}
        draw(made, picture, [row for row in others if row.scene in scenes])
        tell(f"{len(made.rows)} configurations, {len(front(made.rows))} on the front: {picture}")
        if pick is not None:
            row = pick_row(made.rows, check.number("--pick", pick, above=0.0))
            if row is None:
                raise InputError(
                    f"no measured configuration is within {pick:g} m; the best is {best_error(made.rows):.2g} m"
                )
            tell(flags(row))
