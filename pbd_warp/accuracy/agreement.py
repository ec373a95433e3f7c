"""Settings that bring a motion within an accuracy, without a chart: found by comparing it with a finer one.

What steps add is bounded by `error`, but the motion itself makes more of it, a chain that cracks some hundred times as
much in a second. So it is run twice, with one `error` and with a tenth of it, from places that differ by what rounding
adds; what then lies between both is how far the first is off, but for about a tenth.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from pbd_warp.accuracy.chart import Row, within
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.grab.controller import play
from pbd_warp.grab.drag import Drag
from pbd_warp.model.model import Model
from pbd_warp.preflight import ROUNDED, preflight
from pbd_warp.scene import Scene
from pbd_warp.settings import Settings
from pbd_warp.simulation import Simulation
from pbd_warp.snapshot import Snapshot

SECONDS = 1.0
"""For which an accuracy is promised, as charts have it; a motion that is chaotic leaves any sooner or later."""

FINER = 10.0
MORE = 1.15
"""Steps that the finer run must have, over the other's: a tenth of the error asks for 1.3 times as many."""

MARGIN = 1.5
"""What the finer run may itself be off, and rounding, on top."""

AIM = 4.0
"""Tried next is what would make the accuracy so many times what the run is off."""

NEEDLESS = 40.0
"""Times more accurate than asked for, where longer steps are tried."""

TRIES = 10


@dataclass(frozen=True)
class Agreement:
    """What was found.

    settings: To run the scene with, in float64.
    off: How far the particle that is worst was off at any frame of the first second [m], by a run ten times finer.
    until: When the scene was last within the accuracy [s], at its end if not before.
    """

    settings: Settings
    off: float
    until: float

    @property
    def flags(self) -> str:
        """The settings as flags of `pbd-warp run`."""
        of = self.settings
        return f"--integrator {of.integrator} --substeps {of.substeps} --error {of.error:.3g} --dtype float64"


def agree(scene: Scene, accuracy: float, device: str | None = None) -> Agreement:
    """Find the steps with which no particle of a scene is off by more than `accuracy` [m] in its first second.

    Raises:
        InputError: the explicit integrator has no equations for something in the scene, or rounding is above that.
        SimulationFailed: no steps are short enough.
    """
    model = scene.builder.finalize(device, "float64")
    frames = max(scene.frames - 1, 1)
    first = min(frames, round(SECONDS * scene.fps))
    error, before, longer = accuracy, (np.inf, np.inf), True
    for _ in range(TRIES):
        settings = scene.settings.keeping(error)
        pair = _Pair(scene, model, settings, settings.keeping(error / FINER), frames)
        off, failure = pair.advance(first)
        if failure is None and pair.steps[1] < MORE * pair.steps[0]:  # most frames of both are a single step
            pair = _Pair(scene, model, settings, settings.changed(substeps=2 * pair.most), frames)
            off, failure = pair.advance(first)
        if failure is not None and error < 1e-6 * accuracy:
            raise failure
        good = off * MARGIN <= accuracy
        if good and not (longer and off * NEEDLESS < accuracy and pair.most > 1):
            until = first
            while until < frames and pair.advance(1)[0] * MARGIN <= accuracy:
                until += 1
            return Agreement(settings, off, until / scene.fps)
        if not good:
            if off > 0.5 * before[1] and error < 0.25 * before[0]:
                break
            before, longer = (error, off), False
        error *= float(np.clip(accuracy / (AIM * max(off, 1e-300)), 1e-2, 1e2))
    raise InputError(
        f"no steps bring scene {scene.name} within {accuracy:g} m: of rounding, its motion makes {before[1]:.2g} m in "
        f"{first / scene.fps:.3g} s"
    )


def charted(scene: Scene, rows: Iterable[Row], accuracy: float) -> Row | None:
    """The fastest settings on a scene's chart within an accuracy [m], of those that are not known to fail: a chart has
    measured one second, and what comes later may be harder. None: there are none."""
    model = scene.builder.finalize(dtype="float64")
    for row in within(rows, accuracy):
        begin = Snapshot(model, row.apply(scene.settings), model.x, model.v, model.w, model.point.target)
        if all(warning.severity <= 1.0 for warning in preflight(begin)):
            return row
    return None


class _Pair:
    """A scene with steps, and with finer ones from places as rounding may leave them, side by side."""

    def __init__(self, scene: Scene, model: Model, settings: Settings, finer: Settings, frames: int):
        self._sims = [Simulation(model, of) for of in (settings, finer)]
        free = ((model.w > 0.0) & ~np.isin(np.arange(model.particle_count), model.point.particle))[:, None]
        rounding = ROUNDED * float(np.finfo(model.x.dtype).eps) * np.abs(model.x).max()
        nudge = rounding * free * np.random.default_rng(0).uniform(-1.0, 1.0, model.x.shape)
        self._sims[1].state.x.assign(model.x + nudge)
        self._runs: list[Iterator[Simulation]] = [play(sim, Drag(scene.drag), frames) for sim in self._sims]
        self.steps = np.zeros(2, dtype=int)
        """Of each, in all frames; `most`: of the first, in one frame."""
        self.most = 1

    def advance(self, frames: int) -> tuple[float, SimulationFailed | None]:
        """How far they were apart at most [m], infinitely far where one failed, and that failure."""
        apart = 0.0
        try:
            for _ in range(frames):
                for run in self._runs:
                    next(run)
                one, finer = self._sims
                self.steps += [one.substeps_used, finer.substeps_used]
                self.most = max(self.most, one.substeps_used)
                apart = max(apart, float(np.linalg.norm(one.positions - finer.positions, axis=1).max()))
        except SimulationFailed as failure:
            return np.inf, failure
        return apart, None
