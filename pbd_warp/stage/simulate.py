"""Simulates the curves of a stage, from its first frame to its last."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from pxr import Vt

import pbd_warp
from pbd_warp.animation import Animation
from pbd_warp.measure import measure
from pbd_warp.run import RunStats, make_simulation, say_what_is_kept
from pbd_warp.simulation import Simulation
from pbd_warp.stage.scene import StageScene
from pbd_warp.stage.writing import animated_attributes, check_out, flattened, override_layer
from pbd_warp.usd import check_path


def simulate(
    source: StageScene, out: Path, flatten: bool = False, on_frame: Callable[[int], object] = lambda frame: None
) -> RunStats:
    """Simulate a stage's curves and write them as a layer over it: the first frame is as the stage has it.

    Args:
        flatten: One self-contained file instead.
        on_frame: Called after each frame with how many are written. A KeyboardInterrupt from it ends the run.

    Raises:
        InputError: before anything is simulated or written.
        SimulationFailed: the frames so far are kept (see Animation).
    """
    check_path(out)
    check_out(source.stage, out)
    scene, frames = source.scene, source.timeline.frames
    model = scene.builder.finalize(source.device, source.dtype)
    sim = make_simulation(scene, model)
    settings: dict[str, Any] = {
        "scene": scene.name,
        "device": str(model.device),
        "dtype": model.dtype,
        "method": scene.method.name,
        "integrator": scene.integrator,
        "substeps": scene.substeps,
        "iterations": scene.method.iterations,
    }
    metadata = {"version": pbd_warp.__version__, **settings}
    stage = flattened(source, metadata) if flatten else override_layer(source, out, metadata)
    playback = Playback(source, sim)
    animation = Animation(out, stage, animated_attributes(stage, source))
    now = measure(sim)
    energy_start, worst_stretch, worst_residual = now.energy, now.max_stretch, now.residual
    wall, unconverged = 0.0, sim.unconverged
    with say_what_is_kept(animation), animation:
        for frame in range(frames):
            if frame > 0:
                start = time.perf_counter()
                playback.lead(frame)
                sim.step()
                wp.synchronize_device(model.device)
                wall += time.perf_counter() - start
                now = measure(sim)
                worst_stretch = max(worst_stretch, now.max_stretch)
                worst_residual = max(worst_residual, now.residual)
                if unconverged is not None:
                    unconverged += sim.unconverged or 0
            animation.write(playback.frame(frame), source.timeline.time_code(frame))
            on_frame(frame + 1)
    return RunStats(
        **settings,
        frames=frames,
        compile_s=sim.compile_seconds,
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


class Playback:
    """Between a stage's curves and the simulation of their points: where pinned ones go, and what comes out."""

    def __init__(self, source: StageScene, sim: Simulation):
        self._source = source
        self._sim = sim
        ends = np.cumsum([len(curves.x) for curves in source.curves])
        self._ranges = [slice(end - len(curves.x), end) for curves, end in zip(source.curves, ends, strict=True)]
        self._moving = [
            (curves, np.flatnonzero(curves.pinned) + span.start)
            for curves, span in zip(source.curves, self._ranges, strict=True)
            if curves.moving
        ]
        self._x_start = sim.model.x.astype(sim.model.dtype).astype(np.float64)  # as rounded as the state

    def lead(self, frame: int) -> None:
        """Send the pinned points to where they are at a frame, the next one."""
        if not self._moving:
            return
        time_code = self._source.timeline.time_code(frame)
        places = np.concatenate([curves.pins(time_code) for curves, _ in self._moving])
        self._sim.lead(np.concatenate([index for _, index in self._moving]), places - self._source.origin)

    def frame(self, frame: int) -> list[Any]:
        """Values of the animated attributes, prim by prim, at the frame that the simulation is at."""
        timeline = self._source.timeline
        before = timeline.time_code(frame - 1) if frame > 0 else None
        displacement = self._sim.state.x.numpy().astype(np.float64) - self._x_start
        v = self._sim.state.v.numpy().astype(np.float64)
        values: list[Any] = []
        for curves, span in zip(self._source.curves, self._ranges, strict=True):
            points, velocities, extent = curves.frame(
                displacement[span], v[span], timeline.time_code(frame), before, timeline.fps
            )
            values += [Vt.Vec3fArray.FromNumpy(points), Vt.Vec3fArray.FromNumpy(velocities), extent]
        return values
