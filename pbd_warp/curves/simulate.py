"""Simulates the curves of a stage, from its first frame to its last."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from pxr import Vt

from pbd_warp.curves.layer import animated_attributes, flattened, layer_files, override_layer
from pbd_warp.curves.scene import StageScene
from pbd_warp.figures import RunStats, provenance
from pbd_warp.identity import Identity, digest_of_files
from pbd_warp.model.model import Model, State
from pbd_warp.paths import animation_files, check_apart
from pbd_warp.run import Hooks, make_frames, tell_cost
from pbd_warp.simulation import Simulation
from pbd_warp.usd.animation import Animation
from pbd_warp.usd.writer import check_path


def simulate(
    source: StageScene,
    out: Path,
    flatten: bool = False,
    hooks: Hooks = Hooks(),  # noqa: B008 it is frozen
) -> RunStats:
    """Simulate a stage's curves and write them as a layer over it: the first frame is as the stage has it.

    Args:
        flatten: One self-contained file instead.

    Raises:
        InputError: before anything is simulated or written.
        SimulationFailed: the frames so far are kept (see Animation).
    """
    out = check_path(out)
    read = layer_files(source.stage)
    check_apart({"the stage": read}, {"the output": animation_files(out)})
    scene = source.scene.changed(frames=source.timeline.frames, dt=1.0 / source.timeline.fps)
    model = scene.builder.finalize(source.device, source.dtype)
    tell_cost(model, scene.settings, hooks)
    sim = Simulation(model, scene.settings)
    made_by = provenance(scene, model)
    stage = flattened(source, made_by) if flatten else override_layer(source, out, made_by)
    playback = Playback(source, model)

    def open_writer(resume: int | None, identity: Identity) -> StageWriter:
        attributes = animated_attributes(stage, source)
        return StageWriter(playback, Animation(out, stage, attributes, resume, identity=identity))

    timeline = source.timeline
    said = [[curves.path for curves in source.curves], timeline.start, timeline.fps, timeline.time_codes_per_second]
    return make_frames(scene, sim, playback, open_writer, out, hooks, digest_of_files(read, said))


class StageWriter:
    """Writes frames over a stage; what becomes of an interrupted file is up to Animation."""

    def __init__(self, playback: Playback, animation: Animation):
        self._playback = playback
        self._animation = animation
        self.flush = animation.flush

    def write(self, state: State) -> None:
        frame = self.frames
        self._animation.write(self._playback.frame(frame, state), self._playback.time_code(frame))

    @property
    def frames(self) -> int:
        return self._animation.frames

    @property
    def saved(self) -> Path | None:
        return self._animation.saved

    def __enter__(self) -> StageWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._animation.__exit__(kind, error, trace)


class Playback:
    """Between a stage's curves and the simulation of their points: where pinned ones go, and what comes out."""

    def __init__(self, source: StageScene, model: Model):
        self._source = source
        self.time_code = source.timeline.time_code
        ends = np.cumsum([len(curves.x) for curves in source.curves])
        self._ranges = [slice(end - len(curves.x), end) for curves, end in zip(source.curves, ends, strict=True)]
        self._moving = [
            (curves, np.flatnonzero(curves.pinned) + span.start)
            for curves, span in zip(source.curves, self._ranges, strict=True)
            if curves.moving
        ]
        self._x_start = model.x.astype(model.dtype).astype(np.float64)  # as rounded as the state

    script = memory = None  # where pinned points are depends on the stage and the frame alone

    def resume(self, memory: None, sim: Simulation) -> Simulation:
        return sim

    def advance(self, sim: Simulation) -> Simulation:
        """Send the pinned points to where they are at the next frame."""
        if self._moving:
            places = np.concatenate([curves.pins(self.time_code(sim.frame + 1)) for curves, _ in self._moving])
            sim.lead(np.concatenate([index for _, index in self._moving]), places - self._source.origin)
        return sim

    def frame(self, frame: int, state: State) -> list[Any]:
        """Values of the animated attributes, prim by prim, at a frame of that state."""
        timeline = self._source.timeline
        before = self.time_code(frame - 1) if frame > 0 else None
        displacement = state.x.numpy().astype(np.float64) - self._x_start
        v = state.v.numpy().astype(np.float64)
        values: list[Any] = []
        for curves, span in zip(self._source.curves, self._ranges, strict=True):
            points, velocities, extent = curves.frame(
                displacement[span], v[span], self.time_code(frame), before, timeline.fps
            )
            values += [Vt.Vec3fArray.FromNumpy(points), Vt.Vec3fArray.FromNumpy(velocities), extent]
        return values
