"""Runs a scene from its first frame to its last, into a USD file."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import warp as wp

from pbd_warp import check
from pbd_warp.checkpoint import Checkpoint
from pbd_warp.errors import InputError, Interrupted, SimulationFailed
from pbd_warp.grab.controller import Controller, play
from pbd_warp.grab.drag import Drag
from pbd_warp.grab.recording import Recording, Replay
from pbd_warp.measure import measure
from pbd_warp.model.model import Model, State
from pbd_warp.player.motion import EXTENSIONS
from pbd_warp.player.writer import MotionWriter
from pbd_warp.preflight import PreflightWarning
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.usd.writer import UsdWriter
from pbd_warp.version import __version__


@dataclass(frozen=True)
class RunStats:
    """What a run was and how it went; the fields are the keys of `--stats FILE.json`.

    unconverged: Steps that ended above the method's tolerance, None where it has none.
    retried: Frames that were made again after a failure (`on_failure`).
    wall_s: The whole run [s], from the first check to the closed file; since it was resumed, if it was.
    real_time_factor: Simulated time over that of simulating it; None of a single frame.
    """

    scene: str
    device: str
    dtype: str
    method: str
    integrator: str
    substeps: int
    iterations: int
    frames: int
    compile_s: float
    wall_ms_per_frame: float
    max_stretch: float
    max_residual: float
    energy_start: float
    energy_end: float
    particles: int
    constraints: int
    out: str
    unconverged: int | None
    retried: int
    wall_s: float
    real_time_factor: float | None

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(vars(self), indent=2) + "\n")


@dataclass(frozen=True)
class Checkpoints:
    """Where a run leaves what it needs to go on: `path`, anew after `every` frames. resume: Go on from it."""

    path: Path
    every: int = 100
    resume: bool = False

    def __post_init__(self) -> None:
        check.whole("every", self.every, low=1)
        check.folder(self.path.parent)
        if self.path.is_dir():
            raise InputError(f"checkpoint {self.path} is a folder; name a file in it")


@dataclass
class _Progress:
    """The running figures of a run; with them it is resumed."""

    frames: int
    energy_start: float
    energy: float
    max_stretch: float
    max_residual: float
    unconverged: int | None
    wall: float = 0.0

    def note(self, sim: Simulation, seconds: float) -> None:
        """Another frame."""
        now = measure(sim)
        self.energy = now.energy
        self.max_stretch = max(self.max_stretch, now.max_stretch)
        self.max_residual = max(self.max_residual, now.residual)
        if sim.unconverged is not None:
            self.unconverged = (self.unconverged or 0) + sim.unconverged
        self.wall += seconds


class Writer(Protocol):
    """Writes frames: `UsdWriter`, or the one that writes over a USD stage."""

    def write(self, state: State) -> None: ...
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
    on_warning: Called before the first step with each thing that is known to fail (`Simulation.check`).
    on_drawn: Called while a video is drawn, at the end, with how many of how many pictures are done.
    checkpoints: A resumed run ends with the same file as one that never stopped. None: none are left.
    """

    on_frame: Callable[[int], object] = lambda frame: None
    on_warning: Callable[[PreflightWarning], object] = lambda warning: None
    on_drawn: Callable[[int, int], object] = lambda done, of: None
    checkpoints: Checkpoints | None = None


def run(
    scene: Scene,
    out: Path,
    device: str | None = None,
    dtype: str = "float32",
    hooks: Hooks = Hooks(),
    recording: Recording | None = None,
) -> RunStats:
    """Simulate a scene and write its frames to `out`, a USD animation, a page that plays them or a video: frame 0
    is the initial state, scene.frames there are in all.

    Args:
        recording: A recording to be done again, with its settings, instead of the scene's drag.

    Raises:
        InputError: before anything is simulated or written.
        SimulationFailed: the frames so far are kept (see UsdWriter).
    """
    check.whole("frames", scene.frames, low=1)
    model = scene.builder.finalize(device=device, dtype=dtype)
    controller: Drag | Replay
    if recording is None:
        controller = Drag(scene.drag)
        controller.check_particles(model.particle_count)
        sim = Simulation(model, scene.settings)
    else:
        controller = recording.replay(scene, model)
        sim = controller.begin()

    if out.suffix in EXTENSIONS and hooks.checkpoints:
        raise InputError(f"{out} cannot be gone on with: leave checkpoints of a .usdc, and play that at the end")

    def open_writer(resume: int | None) -> Writer:
        if out.suffix in EXTENSIONS:
            return MotionWriter(out, model, scene.fps, scene.name, hooks.on_drawn)
        return UsdWriter(out, model, scene.fps, provenance(scene, model), resume)

    return make_frames(scene, sim, controller, open_writer, out, hooks)


def provenance(scene: Scene, model: Model) -> dict[str, Any]:
    """How a file was made, for its customLayerData."""
    return {
        "version": __version__,
        "scene": scene.name,
        "device": str(model.device),
        "dtype": model.dtype,
        "method": scene.settings.method.name,
        "integrator": scene.settings.integrator,
        "substeps": scene.settings.substeps,
        "iterations": scene.settings.method.iterations,
    }


def make_frames(
    scene: Scene,
    sim: Simulation,
    controller: Controller,
    open_writer: Callable[[int | None], Writer],
    out: Path,
    hooks: Hooks,
) -> RunStats:
    """All frames of a scene: lead, step, write.

    Args:
        open_writer: Gives what writes them; its argument is how many of them are there already.
    """
    began = time.perf_counter()
    made_by = provenance(scene, sim.model)
    checkpoints = hooks.checkpoints
    if checkpoints and checkpoints.path.absolute() == out.absolute():
        raise InputError(f"checkpoint and output are the same file {out}: name another")
    for warning in sim.check():
        hooks.on_warning(warning)
    now = measure(sim)
    progress = _Progress(0, now.energy, now.energy, now.max_stretch, now.residual, sim.unconverged)
    compile_seconds = sim.compile_seconds
    if checkpoints and checkpoints.resume:
        extra = Checkpoint.read(checkpoints.path).extra
        if not {"controller", "progress"} <= extra.keys():
            raise InputError(f"checkpoint {checkpoints.path} was not left by a run: go on from it with Simulation.load")
        sim = controller.resume(extra["controller"], sim)
        sim.restore(checkpoints.path)
        progress = _Progress(**extra["progress"])
        if progress.frames >= scene.frames:
            raise InputError(
                f"checkpoint {checkpoints.path} is of frame {progress.frames}, and {scene.frames} were asked for"
            )
    writer = open_writer(progress.frames or None)
    with report_saved_frames(writer), writer:
        motion = play(sim, controller, scene.frames)
        for frame in range(progress.frames, scene.frames):
            if frame > 0:
                start = time.perf_counter()
                sim = next(motion)
                wp.synchronize_device(sim.model.device)
                progress.note(sim, time.perf_counter() - start)
            writer.write(sim.state)
            progress.frames = frame + 1
            hooks.on_frame(progress.frames)
            if checkpoints and progress.frames % checkpoints.every == 0 and progress.frames < scene.frames:
                writer.flush()  # first, so that the file has every frame up to the checkpoint
                sim.save(checkpoints.path, {"controller": controller.memory, "progress": vars(progress)})
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
        raise SimulationFailed(error.what, where=error.where, remedy=error.remedy, kept=kept or error.kept) from error
