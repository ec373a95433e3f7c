"""Between a stage's curves and the simulation of their points: where pinned ones go, what comes out, what they are
called."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from pbd_warp.curves.colliders import MovingColliders
from pbd_warp.curves.scene import StageScene
from pbd_warp.model.model import Model, State
from pbd_warp.simulation import Simulation

STILL = 1e-6
"""Part of the size of all curves that nobody sees them move by: round-off."""

FAILED = 0.01
"""Stretch of a link, when a frame fails, from which its curve counts as failed."""


class Playback:
    """Leads the pinned points of a stage's curves and its colliders (see `Controller`), and gives what its prims show
    at a frame.

    Attributes:
        moved: Whether any free point has gone anywhere so far.
    """

    script = memory = None  # where pinned points are depends on the stage and the frame alone

    def __init__(self, source: StageScene, model: Model):
        self._source = source
        self._model = model
        self.moved = False
        self.time_code = source.timeline.time_code
        self._ends = np.cumsum([len(curves.x) for curves in source.curves])
        self._ranges = [slice(end - len(each.x), end) for each, end in zip(source.curves, self._ends, strict=True)]
        self._moving = [
            (curves, np.flatnonzero(curves.pinned) + span.start)
            for curves, span in zip(source.curves, self._ranges, strict=True)
            if curves.moving
        ]
        self._colliders = MovingColliders(source.colliders, source.origin)
        self._free = model.w > 0.0
        self._still = STILL * float(np.ptp(model.x, axis=0).max())
        self._x_start = model.x.astype(model.dtype).astype(np.float64)  # as rounded as the state

    def resume(self, memory: None, sim: Simulation) -> Simulation:
        return sim

    def advance(self, sim: Simulation) -> Simulation:
        """Send the pinned points and the colliders to where they are at the next frame."""
        if self._moving:
            places = np.concatenate([curves.pins(self.time_code(sim.frame + 1)) for curves, _ in self._moving])
            sim.lead(np.concatenate([index for _, index in self._moving]), places - self._source.origin)
        self._colliders.advance(sim, self.time_code(sim.frame + 1))
        return sim

    def frame(self, frame: int, state: State, tension: np.ndarray | None = None) -> list[Any]:
        """Values of the animated attributes, prim by prim, at a frame of that state; tension: of all distances [N], as
        the last value of each prim."""
        timeline = self._source.timeline
        before = self.time_code(frame - 1) if frame > 0 else None
        displacement = state.x.numpy().astype(np.float64) - self._x_start
        self.moved = self.moved or bool(np.abs(displacement[self._free]).max(initial=0.0) > self._still)
        v = state.v.numpy().astype(np.float64)
        values: list[Any] = []
        link = 0
        for curves, span in zip(self._source.curves, self._ranges, strict=True):
            values += curves.frame(displacement[span], v[span], self.time_code(frame), before, timeline.fps)
            if tension is not None:
                first, link = link, link + len(curves.sampling.edges)
                values.append(curves.tension(tension[first:link]))
        return values

    def why_still(self) -> str:
        """Why a run in which no free point moved could not do anything else."""
        if self._source.timeline.frames == 1:
            return "one frame shows the curves as they are in the input: ask for more with --frames"
        if not self._free.any():
            return "every point is pinned: choose fewer with --pin"
        if not np.any(self._model.gravity):
            return "there is no gravity, and no pinned point moves"
        return "the curves hang at rest, and no pinned point moves"

    def failed(self, sim: Simulation) -> dict[str, set[int]]:
        """Which curves a frame that failed shows as broken, or in which Newton's method did not converge then, by path
        of the prim."""
        distance = self._model.distance
        x = sim.state.x.numpy().astype(np.float64)
        bad = ~np.isfinite(x).all(axis=1)
        if sim.settings.on_failure != "continue":
            bad |= sim.missed > 0
        with np.errstate(all="ignore"):
            stretched = ~(np.abs(distance.residual(x)) <= FAILED * distance.rest_length)
        bad[distance.edge[stretched].ravel()] = True
        found: dict[str, set[int]] = {}
        for curves, span in zip(self._source.curves, self._ranges, strict=True):
            numbers = np.unique(curves.sampling.curve[bad[span]])
            if numbers.size:
                found[curves.path] = set(numbers.tolist())
        return found

    def least_converged(self, sim: Simulation) -> str:
        """The curve in which Newton's method failed most often, in words; empty where it never did."""
        missed = sim.missed
        if not missed.any():
            return ""
        worst = int(np.argmax(missed))
        curve = self._name([worst]).partition(" of ")[2]
        return f", {missed[worst]} of them of {curve}"

    def in_words(self, sentence: str) -> str:
        """A sentence about the simulation with points of curves where it numbers particles and distances."""
        distance = self._model.distance
        sentence = re.sub(
            r"\bdistance (\d+)", lambda m: f"the link from {self._name(distance.edge[int(m[1])])}", sentence
        )
        sentence = re.sub(r"\bparticles (\d+) and (\d+)", lambda m: self._name([int(m[1]), int(m[2])]), sentence)
        return re.sub(r"\bparticle (\d+)", lambda m: self._name([int(m[1])]), sentence)

    def _name(self, particles: Sequence[int]) -> str:
        names = []
        for particle in map(int, particles):
            prim = int(np.searchsorted(self._ends, particle, side="right"))
            names.append(self._source.curves[prim].name(particle - self._ranges[prim].start))
        (*others, last) = names
        return " and ".join([*(name.split(" of ")[0] for name in others), last])
