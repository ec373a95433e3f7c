"""pbd-warp run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from pbd_warp import check
from pbd_warp.accuracy.agreement import Agreement, agree, charted
from pbd_warp.accuracy.chart import CONFIGURATION, Row, best_error, flags, load
from pbd_warp.accuracy.sweep import charts_folder
from pbd_warp.cli.app import command
from pbd_warp.cli.options import (
    Checkpoint,
    Debug,
    Device,
    Dtype,
    Every,
    Frames,
    Resume,
    SceneName,
    Seed,
    Set,
    Tension,
    scene_file,
    scene_with,
    takes_settings,
)
from pbd_warp.cli.terminal import interruptible, one_sentence, tell, warn
from pbd_warp.errors import InputError
from pbd_warp.figures import RunStats
from pbd_warp.grab.recording import Recording
from pbd_warp.paths import animation_files, check_apart, check_file
from pbd_warp.player.motion import EXTENSIONS
from pbd_warp.player.writer import check_player_path
from pbd_warp.preflight import PreflightWarning
from pbd_warp.progress import progress_bar
from pbd_warp.run import Checkpoints, Hooks, run
from pbd_warp.scene import Scene
from pbd_warp.usd.writer import EXTENSIONS as STAGES
from pbd_warp.usd.writer import check_path


@command("run", "run rope --out rope.html", "run chain --set links=50 --out chain.usdc", "run my_scene.py --fps 30")
@takes_settings
def run_scene(
    scene: SceneName,
    out: Annotated[
        Path | None, typer.Option(help="SCENE.usda unless given; .usda, .usdc, .usd; .html, .mp4, .gif to look at.")
    ] = None,
    tension: Tension = False,
    up: Annotated[str, typer.Option(help="Axis that is up in the file: y or z.")] = "y",
    frames: Frames = None,
    device: Device = None,
    dtype: Dtype = None,
    seed: Seed = None,
    set_: Set = None,
    accuracy: Annotated[
        float | None,
        typer.Option(
            help="Settings within this error [m] after a second: the fastest on its chart that are not known to fail, "
            "or found by trying."
        ),
    ] = None,
    checkpoint: Checkpoint = None,
    every: Every = Checkpoints.every,
    resume: Resume = False,
    drags: Annotated[
        Path | None, typer.Option(help="Do again what `view --record` has written to this file, with its settings.")
    ] = None,
    stats: Annotated[Path | None, typer.Option(help="Write the closing figures to this JSON file.")] = None,
    debug: Debug = False,
    *,
    changes: dict[str, Any],
) -> None:
    """Simulate a scene and write it as a USD animation."""
    with one_sentence(debug):
        built = scene_with(scene, changes, seed, set_, frames)
        if accuracy is not None:
            if changes.keys() & set(CONFIGURATION) or dtype is not None:
                raise InputError(f"--accuracy chooses {', '.join(CONFIGURATION)}: leave those out")
            accuracy = check.number("--accuracy", accuracy, above=0.0)
            chart = charts_folder() / f"{built.name}.csv"
            as_charted = not (changes or set_ or scene_file(scene)) and chart.is_file()
            rows = load(chart).rows if as_charted else ()
            row = charted(built, rows, accuracy)
            if row is not None:
                built, dtype = built.changed(settings=row.apply(built.settings)), row.dtype
                tell(f"--accuracy {accuracy:g}: {flags(row)} (error {row.position_error:.2g} m on the chart)")
            else:
                found = _agree(built, accuracy, device, rows)
                built, dtype = built.changed(settings=found.settings), "float64"
        recording = None
        if drags is not None:
            if changes or any(given is not None for given in (dtype, seed, set_ or None, accuracy)):
                raise InputError("--drags brings the settings it was recorded with: leave others out")
            recording = Recording.load(drags, scene)
            length = recording.frames if frames is None else check.whole("frames", frames, low=1)
            built, dtype = recording.load_scene(scene).changed(frames=length), recording.dtype
        path = check_out(out if out is not None else Path(f"{built.name}.usda"))
        reads = {"the scene": scene_file(scene), "--drags": [drags] if drags is not None else []}
        check_apart(reads, written(path, checkpoint, stats))
        with progress_bar(built.name) as advance, interruptible() as stop_if_asked:
            hooks = hooks_of(checkpoint, every, resume, lambda done: (advance(done, built.frames), stop_if_asked()))
            hooks = replace(hooks, on_drawn=lambda done, of: (advance(done, of), stop_if_asked()))
            result = run(built, path, device, dtype or "float32", hooks, recording, up.upper(), tension)
        if stats is not None:
            result.save(stats)
        tell(table(result))


def check_out(out: Path) -> Path:
    """The path as one that a run can be written to, or an InputError."""
    if out.suffix in EXTENSIONS:
        return check_player_path(out)
    if out.suffix not in STAGES:
        known = ", ".join((*STAGES, *EXTENSIONS))
        raise InputError(f"{out} must end in one of {known}, not in {out.suffix or 'nothing'!r}")
    return check_path(out)


def _agree(scene: Scene, accuracy: float, device: str | None, rows: Sequence[Row]) -> Agreement:
    """Settings within an accuracy that no chart has, told."""
    try:
        found = agree(scene, accuracy, device)
    except InputError as error:
        if rows and best_error(rows) <= accuracy:
            chart = f"what the chart of scene {scene.name} has within {accuracy:g} m is known to fail later"
        elif rows:
            chart = f"no settings on the chart of scene {scene.name} are within {accuracy:g} m, best: "
            chart += f"{best_error(rows):.2g} m"
        else:
            chart = f"scene {scene.name} comes with no chart (pbd-warp chart makes one, and has --pick)"
        raise InputError(f"{chart}; and {error}") from None
    whole = found.until >= (scene.frames - 1) / scene.fps
    within = "all along" if whole else f"up to {found.until:.3g} s, later the motion makes more of it"
    tell(f"--accuracy {accuracy:g}: {found.flags} (off by {found.off:.2g} m in the first second; within it {within})")
    return found


def written(out: Path, checkpoint: Path | None, stats: Path | None) -> dict[str, list[Path]]:
    """The files that a run writes, by their options.

    Raises:
        InputError: one that cannot be written.
    """
    single = {"--checkpoint": checkpoint, "--stats": stats}
    return {"--out": animation_files(out)} | {
        option: [check_file(path)] for option, path in single.items() if path is not None
    }


def hooks_of(checkpoint: Path | None, every: int, resume: bool, on_frame: Callable[[int], object]) -> Hooks:
    """What the command line asks of a run on its way."""
    check.whole("--every", every, low=1)
    if resume and checkpoint is None:
        raise InputError("--resume goes on from a checkpoint: name it with --checkpoint FILE")
    return Hooks(
        on_frame=on_frame,
        on_start=warn,
        on_warning=foretell,
        checkpoints=Checkpoints(checkpoint, every, resume) if checkpoint is not None else None,
    )


def foretell(warning: PreflightWarning) -> None:
    """Say what is known to fail."""
    warn(f"known to fail: {warning.text}", f"helps: {warning.remedy} (test: {warning.test})")


def pace(stats: RunStats) -> str:
    """How fast simulated time went by while nothing else was done."""
    if stats.real_time_factor is None:
        return "too few to tell the pace"
    return f"{stats.real_time_factor:.3g} times real time"


def table(stats: RunStats) -> str:
    """The closing figures of a run."""
    size = Path(stats.out).stat().st_size
    lost = stats.energy_end - stats.energy_start
    rows = {
        "scene": f"{stats.scene}, {stats.particles} particles, {stats.constraints} constraints",
        "frames": f"{stats.frames} at {stats.wall_ms_per_frame:.3f} ms a frame: {pace(stats)}",
        "wall time": f"{stats.wall_s:.2f} s with compiling, measuring and writing",
        "compile": f"{stats.compile_s:.2f} s",
        "max stretch": f"{100 * stats.max_stretch:.3g} %",
        "max residual": f"{stats.max_residual:.3g} m",
        "energy": f"{lost:+.4g} J since the start, {stats.energy_end:.4g} J at the end (0: at rest at y = 0)",
        "file": f"{stats.out}, {size / 1024:.0f} KiB",
    }
    if stats.stretched_frames:
        rows["stretched"] = f"{stats.stretched_frames} frames in which a link was more than 10 % off its length"
    if stats.crossings is not None:
        rows["strands"] = "no strand passed through another"
        if stats.crossings:
            rows["strands"] = f"passed through each other {stats.crossings} times, first {stats.crossed}"
    if stats.unconverged is not None:
        rows["converged"] = f"all but {stats.unconverged} steps" if stats.unconverged else "every step"
    if stats.retried:
        rows["retried"] = f"{stats.retried} frames that had failed"
    return "\n".join(f"{name:13} {value}" for name, value in rows.items())
