"""Runs a scene from its first frame to its last, into a USD file."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import warp as wp

import pbd_warp
from pbd_warp import check
from pbd_warp.drag import Drag
from pbd_warp.errors import Interrupted, SimulationFailed
from pbd_warp.measure import measure
from pbd_warp.model import Model
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.usd import UsdWriter

if TYPE_CHECKING:
    from pbd_warp.take import Replay, Take


@dataclass(frozen=True)
class RunStats:
    """What a run was and how it went; the fields are the keys of `--stats FILE.json`.

    unconverged: Steps that ended above the method's tolerance, None where it has none.
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

    def save(self, path: Path) -> None:
        path.write_text(json.dumps(vars(self), indent=2) + "\n")


def make_simulation(scene: Scene, model: Model) -> Simulation:
    """A simulation of a scene with the scene's settings."""
    return Simulation(
        model,
        1.0 / check.number("fps", scene.fps, above=0.0),
        scene.substeps,
        method=scene.method,
        integrator=scene.integrator,
        damping=scene.damping,
        max_contacts=scene.max_contacts,
    )


def run(
    scene: Scene,
    out: Path,
    device: str | None = None,
    dtype: str = "float32",
    on_frame: Callable[[int], object] = lambda frame: None,
    take: Take | None = None,
) -> RunStats:
    """Simulate a scene and write its frames to `out`: frame 0 is the initial state, scene.frames there are in all.

    Args:
        take: A recording to be done again, with its settings, instead of the scene's drag.
        on_frame: Called after each frame with how many are written. A KeyboardInterrupt from it ends the run.

    Raises:
        InputError: before anything is simulated or written.
        SimulationFailed: the frames so far are kept (see UsdWriter).
    """
    frames = check.whole("frames", scene.frames, low=1)
    model = scene.builder.finalize(device=device, dtype=dtype)
    drag: Drag | Replay
    if take is None:
        drag = Drag(scene.drag)
        drag.check_particles(model.particle_count)
        sim = make_simulation(scene, model)
    else:
        drag = take.replay(scene, model)
        sim = drag.begin()
    settings: dict[str, Any] = {
        "scene": scene.name,
        "device": str(model.device),
        "dtype": model.dtype,
        "method": scene.method.name,
        "integrator": scene.integrator,
        "substeps": scene.substeps,
        "iterations": scene.method.iterations,
    }
    now = measure(sim)
    energy_start, worst_stretch, worst_residual = now.energy, now.max_stretch, now.residual
    wall = 0.0
    unconverged, compile_seconds = sim.unconverged, sim.compile_seconds
    writer = UsdWriter(out, model, scene.fps, {"version": pbd_warp.__version__, **settings})
    with _say_what_is_kept(writer), writer:
        for frame in range(frames):
            if frame > 0:
                sim = drag.advance(sim)
                start = time.perf_counter()
                sim.step()
                wp.synchronize_device(model.device)
                wall += time.perf_counter() - start
                now = measure(sim)
                worst_stretch = max(worst_stretch, now.max_stretch)
                worst_residual = max(worst_residual, now.residual)
                if sim.unconverged is not None:
                    unconverged = (unconverged or 0) + sim.unconverged
            writer.write(sim.state)
            on_frame(frame + 1)
    return RunStats(
        **settings,
        frames=frames,
        compile_s=compile_seconds,
        wall_ms_per_frame=1e3 * wall / max(frames - 1, 1),
        max_stretch=worst_stretch,
        max_residual=worst_residual,
        energy_start=energy_start,
        energy_end=now.energy,
        particles=model.particle_count,
        constraints=model.constraint_count,
        out=str(out),
        unconverged=unconverged,
    )


@contextmanager
def _say_what_is_kept(writer: UsdWriter) -> Iterator[None]:
    """Adds to the error that ends a run early where the frames so far are."""
    try:
        yield
    except (SimulationFailed, KeyboardInterrupt) as error:
        kept = f"; the {writer.frames} frames so far are in {writer.saved}" if writer.saved else ""
        if isinstance(error, KeyboardInterrupt):
            raise Interrupted(f"interrupted{kept}") from error
        raise SimulationFailed(f"{error}{kept}") from error
