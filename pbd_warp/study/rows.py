"""Makes rows of a study: runs of a scene, one after the other, or many of one graph in one simulation."""

from __future__ import annotations

import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pbd_warp.errors import InputError, PbdError
from pbd_warp.grab.controller import play
from pbd_warp.grab.drag import Drag
from pbd_warp.model.copies import graph_of, join
from pbd_warp.model.model import Model
from pbd_warp.scene import Scene, build_scene, defaults_of
from pbd_warp.settings import Settings
from pbd_warp.simulation import Simulation
from pbd_warp.step.integrators import EXPLICIT
from pbd_warp.study.grid import SETTINGS, Grid
from pbd_warp.study.measures import Own, by_name, check_possible, take

Row = dict[str, Any]

TOGETHER_PARTICLES = 2_000_000
"""As many are simulated in one at most: the rest of what a batch holds waits."""


@dataclass(frozen=True)
class Runs:
    """What the rows of a study are made of. It travels to the workers, the functions of the scene and of the measures
    by value where they cannot import them.

    options: Settings of all rows, as the command line names them. frames: Length of the animation, the scene's own
    unless given.
    """

    name: str
    build: Callable[..., Scene]
    grid: Grid
    measures: tuple[str | Own, ...]
    options: dict[str, Any]
    frames: int | None
    dtype: str
    device: str | None

    def scene(self, row: int) -> Scene:
        """The scene of a row, with its settings."""
        values = self.grid[row]
        own = {name: value for name, value in values.items() if name not in self._varied_settings}
        scene = build_scene(self.name, self.build, own)
        options = {**self.options, **{name: values[name] for name in self._varied_settings}}
        scene = scene.changed(settings=scene.settings.with_options(options))
        return scene if self.frames is None else scene.changed(frames=self.frames)

    @property
    def _varied_settings(self) -> list[str]:
        own = defaults_of(self.build)
        return [name for name in self.grid.axes if name in SETTINGS and name not in own]

    def __call__(self, rows: list[int]) -> list[Row]:
        """Make rows. Which ones are made together changes none of them.

        The `outcome` of a row is "finished"; "failed", where the run could not go on (or has killed its process); or
        "refused", its settings before the run, or what is to be measured. `sentence` says why.
        """
        made: dict[int, Row] = {}
        together: dict[Any, list[tuple[int, Scene, Model]]] = {}
        for row in rows:
            try:
                scene = self.scene(row)
                check_possible(self.measures, scene)
                model = scene.builder.finalize(self.device, self.dtype)
            except Exception as error:  # whatever it is, it is this row's, and no other's
                made[row] = _failed(*_told(error))
                continue
            key: Any = row
            if by_name(self.measures) and _stands_copies(scene, model):
                key = scene.settings, scene.frames, graph_of(scene.settings.apply(model))
            together.setdefault(key, []).append((row, scene, model))
        for group in together.values():
            most = max(1, TOGETHER_PARTICLES // group[0][2].particle_count)
            for first in range(0, len(group), most):
                made |= self._run(group[first : first + most])
        return [{"row": row, **self.grid[row], **made[row]} for row in rows]

    def _run(self, group: list[tuple[int, Scene, Model]]) -> dict[int, Row]:
        """Runs that differ in what copies may differ in."""
        rows, scenes, models = (list(column) for column in zip(*group, strict=True))
        if len(rows) > 1:
            found = self._simulate(scenes, join(models))
            if found is not None:
                return dict(zip(rows, found, strict=True))
        return {row: self._alone(scene, model) for row, scene, model in group}

    def _alone(self, scene: Scene, model: Model) -> Row:
        found = self._simulate([scene], model)
        assert found is not None
        return found[0]

    def _simulate(self, scenes: Sequence[Scene], model: Model) -> list[Row] | None:
        """The rows of the copies of a model; None where what went wrong cannot be told by copy, but only alone."""
        first, n = scenes[0], len(scenes)
        base: list[Row] = [_settings(scene.settings) | {"frames": scene.frames} for scene in scenes]
        started, error = time.perf_counter(), None
        sim: Simulation | None = None
        try:
            sim = Simulation(model, first.settings)
            started = time.perf_counter()
            for now in play(sim, Drag(first.drag), first.frames - 1):
                sim = now
        except Exception as failed:
            error = failed
        if sim is None or (n > 1 and error and len(sim.failures) < n):
            return None if n > 1 else [base[0] | _failed(*_told(error))]
        wall = (time.perf_counter() - started) / n
        where = {"wall_s": wall, "together": n, "machine": platform.node(), "device": str(model.device)}
        if n == 1 and error is not None:
            return [base[0] | _failed(*_told(error)) | where]
        try:
            measured = take(sim, scenes, self.measures)
        except Exception as failed:
            return None if n > 1 else [base[0] | _failed(*_told(failed)) | where]
        done = {"outcome": "finished", "sentence": ""}
        return [
            base[k] | (_failed("failed", sim.failures[k]) if k in sim.failures else done | measured[k]) | where
            for k in range(n)
        ]


def lost(runs: Runs, row: int, deaths: int) -> Row:
    """The row of a run that its workers did not survive."""
    return {"row": row, **runs.grid[row], **_failed("failed", f"it has killed its worker {deaths} times")}


def _failed(outcome: str, why: object) -> Row:
    return {"outcome": outcome, "sentence": str(why)}


def _told(error: Exception | None) -> tuple[str, str]:
    """The outcome and the sentence of what went wrong."""
    if isinstance(error, PbdError):
        return "refused" if isinstance(error, InputError) else "failed", str(error)
    return "failed", f"{type(error).__name__}: {str(error) or 'no more is known'}"


def _settings(settings: Settings) -> Row:
    """The settings of a row as columns, as the command line names them."""
    values = {name: value for name, value in settings.to_json().items() if name in SETTINGS and name != "method"}
    method = settings.method
    return {
        "method": method.name,
        **{k: v for k, v in vars(method).items() if k in SETTINGS},
        "fps": settings.fps,
    } | values


def _stands_copies(scene: Scene, model: Model) -> bool:
    """Whether a run comes out the same beside others: nothing but its own particles decides what it does."""
    settings = scene.settings
    method = settings.method
    one_by_one = settings.integrator in EXPLICIT or settings.on_failure in ("subdivide", "fallback")
    decides_for_all = method.name != "direct" and method.tolerance is not None
    decides_for_all |= getattr(method, "chebyshev", None) is not None
    return not (scene.drag or model.collides or one_by_one or decides_for_all)
