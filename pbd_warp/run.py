"""Runs a scene from its first frame to its last, into a USD file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.atomic import clear_hidden, through_links
from pbd_warp.checkpoint import Checkpoint
from pbd_warp.cost import too_much
from pbd_warp.errors import InputError, Interrupted, SimulationFailed
from pbd_warp.figures import Progress, RunStats, provenance, watch
from pbd_warp.grab.controller import Controller, play
from pbd_warp.grab.drag import Drag
from pbd_warp.grab.recording import Recording, Replay
from pbd_warp.identity import Identity
from pbd_warp.lock import Lock
from pbd_warp.measure import measure
from pbd_warp.model.model import Model, State
from pbd_warp.paths import animation_files, check_apart, check_file
from pbd_warp.player.motion import EXTENSIONS
from pbd_warp.player.writer import MotionWriter
from pbd_warp.preflight import PreflightWarning
from pbd_warp.scene import Scene
from pbd_warp.settings import Settings
from pbd_warp.simulation import Simulation
from pbd_warp.usd.writer import UsdWriter


@dataclass(frozen=True)
class Checkpoints:
    """Where a run leaves what it needs to go on: `path`, anew after `every` frames. resume: Go on from it."""

    path: Path
    every: int = 100
    resume: bool = False

    def __post_init__(self) -> None:
        check.whole("every", self.every, low=1)
        check_file(self.path)


class Writer(Protocol):
    """Writes frames: `UsdWriter`, or the one that writes over a USD stage.

    tension: Whether each comes with tensions.
    """

    @property
    def tension(self) -> bool: ...
    def write(self, state: State, tension: np.ndarray | None = None) -> None: ...
    def flush(self) -> None: ...
    @property
    def frames(self) -> int: ...
    @property
    def saved(self) -> Path | None: ...
    def __enter__(self) -> Any: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


@dataclass(frozen=True)
class Hooks:
    """What a run tells while it goes on, and where it leaves checkpoints.

    on_frame: Called after each frame with how many are written. A KeyboardInterrupt from it ends the run.
    on_start: Called before anything else with what will take very long, as a sentence.
    on_warning: Called before the first step with each thing that is known to fail (`Simulation.check`).
    on_drawn: Called while a video is drawn, at the end, with how many of how many pictures are done.
    checkpoints: A resumed run ends with the same file as one that never stopped. None: none are left.
    """

    on_frame: Callable[[int], object] = lambda frame: None
    on_start: Callable[[str], object] = lambda sentence: None
    on_warning: Callable[[PreflightWarning], object] = lambda warning: None
    checkpoints: Checkpoints | None = None
    on_drawn: Callable[[int, int], object] = lambda done, of: None


def run(
    scene: Scene,
    out: Path,
    device: str | None = None,
    dtype: str = "float32",
    hooks: Hooks = Hooks(),
    recording: Recording | None = None,
    up_axis: str = "Y",
    tension: bool = False,
) -> RunStats:
    """Simulate a scene and write its frames to `out`, a USD animation, a page that plays them or a video: frame 0
    is the initial state, scene.frames there are in all.

    Args:
        recording: A recording to be done again, with its settings, instead of the scene's drag.
        up_axis, tension: Of the file, see UsdWriter. A page has tensions wherever the method knows them.

    Raises:
        InputError: before anything is simulated or written.
        SimulationFailed: the frames so far are kept (see UsdWriter).
    """
    check.whole("frames", scene.frames, low=1)
    model = scene.builder.finalize(device=device, dtype=dtype)
    tell_cost(model, scene.settings, hooks)
    controller: Drag | Replay
    if recording is None:
        controller = Drag(scene.drag)
        controller.check_particles(model.particle_count)
        sim = Simulation(model, scene.settings)
    else:
        controller = recording.replay(scene, model)
        sim = controller.begin()

    used = [sim.settings] if recording is None else recording.all_settings
    if tension:
        check_keeps_forces(*used)
    keeps_forces = all(settings.method.keeps_forces for settings in used)
    if out.suffix in EXTENSIONS and hooks.checkpoints:
        raise InputError(f"{out} cannot be gone on with: leave checkpoints of a .usdc, and play that at the end")

    def open_writer(resume: int | None, identity: Identity) -> Writer:
        if out.suffix in EXTENSIONS:
            return MotionWriter(
                out, model, scene.fps, scene.name, hooks.on_drawn, keeps_forces and out.suffix == ".html"
            )
        made_by = provenance(scene, model)
        return UsdWriter(out, model, scene.fps, made_by, resume, up_axis, identity=identity, tension=tension)

    stage = f"{up_axis} up" + (", with tension" if tension else "")
    return make_frames(scene, sim, controller, open_writer, out, hooks, stage)


def check_keeps_forces(*used: Settings) -> None:
    """Raises an InputError where tensions are not known with one of the settings."""
    for settings in used:
        if not settings.method.keeps_forces:
            what = f"tension is known with method 'direct', not with {settings.method.name!r}"
            raise InputError(what, remedy="use method='direct'")


def tell_cost(model: Model, settings: Settings, hooks: Hooks) -> None:
    """Say, before a simulation is built, that it will take very long."""
    sentence = too_much(model, settings)
    if sentence:
        hooks.on_start(sentence)


def make_frames(
    scene: Scene,
    sim: Simulation,
    controller: Controller,
    open_writer: Callable[[int | None, Identity], Writer],
    out: Path,
    hooks: Hooks,
    stage: str = "",
) -> RunStats:
    """All frames of a scene: lead, step, write.

    Args:
        open_writer: Gives what writes them; its arguments are how many of them are there already, and whose they are.
        stage: What the frames depend on besides: a digest of the USD stage that the scene is read from, for instance.
    """
    checkpoints = hooks.checkpoints
    if checkpoints is None:
        return _make_frames(scene, sim, controller, open_writer, out, hooks, stage)
    check_apart({}, {"the output": animation_files(out), "the checkpoint": [checkpoints.path]})
    with Lock(checkpoints.path):
        clear_hidden(through_links(checkpoints.path))
        return _make_frames(scene, sim, controller, open_writer, out, hooks, stage)


def _make_frames(
    scene: Scene,
    sim: Simulation,
    controller: Controller,
    open_writer: Callable[[int | None, Identity], Writer],
    out: Path,
    hooks: Hooks,
    stage: str,
) -> RunStats:
    began = time.perf_counter()
    made_by = provenance(scene, sim.model)
    checkpoints = hooks.checkpoints
    identity = Identity.of(sim.model, sim.settings, controller.script, stage)
    for warning in sim.check():
        hooks.on_warning(warning)
    now = measure(sim)
    progress = Progress(0, now.energy, now.energy, now.max_stretch, now.residual, sim.unconverged)
    compile_seconds = sim.compile_seconds
    if checkpoints and checkpoints.resume:
        extra = Checkpoint.read(checkpoints.path).extra
        if not {"controller", "progress", "run"} <= extra.keys():
            raise InputError(f"checkpoint {checkpoints.path} was not left by a run: go on from it with Simulation.load")
        identity.refuse_other(extra["run"], f"checkpoint {checkpoints.path}", ("drags", "stage"))
        sim = controller.resume(extra["controller"], sim)
        sim.restore(checkpoints.path)
        identity.refuse_other(extra["run"], f"checkpoint {checkpoints.path}")
        progress = Progress.of(extra["progress"])
        if progress.frames != sim.frame + 1:
            raise InputError(f"checkpoint {checkpoints.path} is of two different frames: start from the beginning")
        if progress.frames >= scene.frames:
            raise InputError(
                f"checkpoint {checkpoints.path} is of frame {progress.frames}, and {scene.frames} were asked for"
            )
    watch(sim)
    writer = open_writer(progress.frames or None, identity)
    with report_saved_frames(writer), writer:
        motion = play(sim, controller, scene.frames)
        for frame in range(progress.frames, scene.frames):
            if frame > 0:
                start = time.perf_counter()
                sim = next(motion)
                wp.synchronize_device(sim.model.device)
                progress.note(sim, time.perf_counter() - start)
            writer.write(sim.state, sim.tension if writer.tension else None)
            progress.frames = frame + 1
            hooks.on_frame(progress.frames)
            if checkpoints and progress.frames % checkpoints.every == 0 and progress.frames < scene.frames:
                writer.flush()  # first, so that the file has every frame up to the checkpoint
                state = {"controller": controller.memory, "progress": vars(progress), "run": identity.to_json()}
                sim.save(checkpoints.path, state)
    made_by.pop("version")
    return RunStats(
        **made_by,
        frames=scene.frames,
        compile_s=compile_seconds,
        wall_ms_per_frame=1e3 * progress.wall / max(scene.frames - 1, 1),
        max_stretch=progress.max_stretch,
        max_residual=progress.max_residual,
        energy_start=progress.energy_start,
        energy_end=progress.energy,
        particles=sim.model.particle_count,
        constraints=sim.model.constraint_count,
        out=str(out),
        unconverged=progress.unconverged,
        stretched_frames=progress.stretched_frames,
        crossings=progress.crossings,
        crossed=progress.crossed,
        retried=sim.retried,
        wall_s=time.perf_counter() - began + compile_seconds,
        real_time_factor=(scene.frames - 1) / scene.fps / progress.wall if progress.wall else None,
    )


@contextmanager
def report_saved_frames(writer: Writer) -> Iterator[None]:
    """Adds to the error that ends a run early where the frames so far are."""
    try:
        yield
    except (SimulationFailed, KeyboardInterrupt) as error:
        kept = f"the {writer.frames} frames so far are in {writer.saved}" if writer.saved else ""
        if isinstance(error, KeyboardInterrupt):
            raise Interrupted("interrupted", kept=kept) from error
        raise error.keeping(kept) from error
