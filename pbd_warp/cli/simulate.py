"""pbd-warp simulate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pbd_warp import check
from pbd_warp.cli.app import command
from pbd_warp.cli.options import Checkpoint, Debug, Device, Dtype, Every, Resume, changed, takes_settings
from pbd_warp.cli.run import hooks_of, table
from pbd_warp.cli.terminal import interruptible, one_sentence
from pbd_warp.curves import Material, load_stage, simulate
from pbd_warp.curves.scene import GRAVITY
from pbd_warp.progress import progress_bar
from pbd_warp.run import Checkpoints
from pbd_warp.usd.writer import check_path


@command(
    "simulate",
    "simulate room.usda --out sim.usda",
    "simulate room.usda --out sim.usda --prim '/World/Cables' --collide '/World/Floor' --pin ends",
)
@takes_settings
def simulate_stage(
    stage: Annotated[Path, typer.Argument(metavar="STAGE", help="A .usda, .usdc, .usd or .usdz file.")],
    out: Annotated[Path, typer.Option(help="The layer to write over it; .usda, .usdc or .usd.")],
    prim: Annotated[
        list[str] | None,
        typer.Option(metavar="PATTERN", help="Path of BasisCurves (* ? []), or of what they are in; all unless given."),
    ] = None,
    collide: Annotated[
        list[str] | None, typer.Option(metavar="PATTERN", help="Path of planes and spheres to collide with.")
    ] = None,
    pin: Annotated[
        str | None, typer.Option(help="Points that follow their parent: root, ends, none or primvar:NAME. [root]")
    ] = None,
    density: Annotated[float | None, typer.Option(help="kg/m^3, widths being diameters. [1000]")] = None,
    mass: Annotated[float | None, typer.Option(help="kg a curve, instead of a density.")] = None,
    compliance: Annotated[float | None, typer.Option(help="Of each link [m/N]. [0]")] = None,
    gravity: Annotated[float, typer.Option(help="Against the stage's up axis [m/s^2].")] = GRAVITY,
    flatten: Annotated[bool, typer.Option("--flatten", help="Write one self-contained file.")] = False,
    frames: Annotated[int | None, typer.Option(help="Frames to write; the stage's range unless given.")] = None,
    fps: Annotated[
        float | None, typer.Option(help="Frames a second; the stage's timeCodesPerSecond unless given.")
    ] = None,
    device: Device = None,
    dtype: Dtype = None,
    checkpoint: Checkpoint = None,
    every: Every = Checkpoints.every,
    resume: Resume = False,
    stats: Annotated[Path | None, typer.Option(help="Write the closing figures to this JSON file.")] = None,
    debug: Debug = False,
    *,
    changes: dict[str, Any],
) -> None:
    """Simulate the curves of a USD stage and write the animation as a layer over it."""
    with one_sentence(debug):
        check_path(out)
        if stats is not None:
            check.folder(stats.parent)
        source = load_stage(
            stage,
            prim or (),
            collide or (),
            Material(pin, density, mass, compliance),
            gravity,
            frames,
            fps,
            device,
            dtype or "float32",
        )
        source = source.changed(settings=changed(source.scene.settings, changes))
        total = source.timeline.frames
        with progress_bar(source.scene.name) as advance, interruptible() as stop_if_asked:
            hooks = hooks_of(checkpoint, every, resume, lambda done: (advance(done, total), stop_if_asked()))
            result = simulate(source, out, flatten, hooks)
        if stats is not None:
            result.save(stats)
        typer.echo(table(result))
