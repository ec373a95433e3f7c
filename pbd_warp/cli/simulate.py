"""pbd-warp simulate."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from pbd_warp.cli.app import command
from pbd_warp.cli.options import Checkpoint, Debug, Device, Dtype, Every, Resume, Tension, takes_settings
from pbd_warp.cli.run import hooks_of, table, written
from pbd_warp.cli.terminal import interruptible, one_sentence, tell, warn
from pbd_warp.curves import Material, StageHooks, load_stage, simulate
from pbd_warp.curves.layer import layer_files
from pbd_warp.paths import check_apart
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
        typer.Option(metavar="PATTERN", help="Path of curves (* ? []), or of what they are in; all unless given."),
    ] = None,
    skip: Annotated[
        list[str] | None, typer.Option(metavar="PATTERN", help="Path of curves to leave as they are.")
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Fail where some curves cannot be simulated, instead of leaving them.")
    ] = False,
    collide: Annotated[
        list[str] | None, typer.Option(metavar="PATTERN", help="Path of meshes, solids, planes to collide with.")
    ] = None,
    pin: Annotated[
        str | None, typer.Option(help="Points that follow their parent: root, ends, none or primvar:NAME. [root]")
    ] = None,
    density: Annotated[float | None, typer.Option(help="kg/m^3, widths being diameters. [1000]")] = None,
    mass: Annotated[float | None, typer.Option(help="kg a curve, instead of a density.")] = None,
    compliance: Annotated[float | None, typer.Option(help="Of each link [m/N]. [0]")] = None,
    youngs_modulus: Annotated[
        float | None, typer.Option(help="Of ropes that resist bending [Pa], widths being diameters.")
    ] = None,
    gravity: Annotated[
        float | None, typer.Option(help="Against the up axis [m/s^2]; the stage's physics scene's unless given. [9.81]")
    ] = None,
    flatten: Annotated[bool, typer.Option("--flatten", help="Write one self-contained file.")] = False,
    tension: Tension = False,
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
        outputs = written(check_path(out), checkpoint, stats)
        check_apart({"the stage": [stage]}, outputs)
        chosen = Material(pin, density, mass, compliance, youngs_modulus)
        clock = Stopwatch()
        with progress_bar(stage.stem) as advance, interruptible() as stop_if_asked:

            def begin(phase: str) -> None:
                clock.begin(phase)
                advance(clock.done, clock.total, phase)

            def frame_done(done: int) -> None:
                clock.done = done
                stop_if_asked()

            begin("reading")
            source = load_stage(
                stage,
                prim or (),
                collide or (),
                chosen,
                gravity,
                frames,
                fps,
                device,
                dtype or "float32",
                skip or (),
                strict,
            )
            check_apart({"the stage": layer_files(source.stage)}, outputs)
            for text in (*source.notes, *source.left):
                warn(text)
            source = source.changed(settings=source.scene.settings.with_options(changes))
            clock.total = source.timeline.frames
            hooks = hooks_of(checkpoint, every, resume, frame_done)
            told = StageHooks(**vars(hooks), on_note=warn, on_phase=begin)
            result = simulate(source, out, flatten, told, strict, tension)
            clock.begin("")
        if stats is not None:
            result.save(stats)
        tell(f"{table(result)}\n{'time':13} {clock}")


class Stopwatch:
    """How long each phase of a run took [s], and how far it is."""

    def __init__(self) -> None:
        self.done = 0
        self.total: int | None = None
        self._spent: dict[str, float] = {}
        self._phase, self._since = "", time.perf_counter()

    def begin(self, phase: str) -> None:
        now = time.perf_counter()
        self._spent[self._phase] = self._spent.get(self._phase, 0.0) + now - self._since
        self._phase, self._since = phase, now

    def __str__(self) -> str:
        return ", ".join(f"{phase} {seconds:.2f} s" for phase, seconds in self._spent.items() if phase)
