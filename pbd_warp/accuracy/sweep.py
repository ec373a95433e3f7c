"""Measures a scene under many settings: the rows of a speed-against-accuracy chart."""

from __future__ import annotations

import datetime
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.accuracy.chart import NO_METHOD, Chart, Row
from pbd_warp.cores import alone_on_a_core
from pbd_warp.errors import InputError, SimulationFailed, unknown
from pbd_warp.grab.controller import play
from pbd_warp.grab.drag import Drag
from pbd_warp.measure import measure
from pbd_warp.model.model import Model
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.step.divergence import STRETCHED, Limits
from pbd_warp.step.integrators import ESTIMATING, EXPLICIT, INTEGRATORS
from pbd_warp.step.methods import METHODS, Direct, Jacobi
from pbd_warp.version import __version__
from pbd_warp.workers import Lost, Pool, ThisProcess

SECONDS = 1.0
"""What is simulated. Chains are chaotic later: then errors say nothing about the method."""

FINER = 16
"""A scene without an exact reference is compared with itself at so many times the substeps, in float64."""

FLOAT32_ERROR = 1e-6
"""Less is no error that float32 could keep [m/s]: steps without end, of which each is rounded."""

ENOUGH = 1.0
"""Repetitions stop after this many seconds."""


@dataclass(frozen=True)
class Sweep:
    """What to combine. Direct iterates to its tolerance, so `iterations` are for the other methods; an integrator that
    takes no method makes steps of the same numbers, and those that keep `errors` [m/s]."""

    methods: Sequence[str] = tuple(METHODS)
    integrators: Sequence[str] = (*INTEGRATORS, *EXPLICIT)
    substeps: Sequence[int] = (1, 2, 4, 8, 16, 32, 64)
    iterations: Sequence[int] = (1, 4, 16)
    errors: Sequence[float] = tuple(10.0**-k for k in range(1, 13))
    dtypes: Sequence[str] = ("float32", "float64")
    repeat: int = 5

    def __post_init__(self) -> None:
        for kind, names, known in (
            ("method", self.methods, METHODS),
            ("integrator", self.integrators, {**INTEGRATORS, **EXPLICIT}),
        ):
            for name in names:
                if name not in known:
                    raise unknown(kind, name, known)
        for dtype in self.dtypes:
            if dtype not in ("float32", "float64"):
                raise unknown("dtype", dtype, ("float32", "float64"))
        for name in ("substeps", "iterations"):
            for value in getattr(self, name):
                check.whole(name, value, low=1)
        for value in self.errors:
            check.number("errors", value, above=0.0)
        check.whole("repeat", self.repeat, low=1)

    def configurations(self, scene: Scene) -> list[Scene]:
        """The scene in all combinations that it can be simulated in."""
        looping = [name for name in self.integrators if name in INTEGRATORS]
        explicit = [name for name in self.integrators if name in EXPLICIT]
        return [
            scene.changed(method=method, integrator=integrator, substeps=substeps)
            for name in self.methods
            for method in self._methods(name)
            for integrator, substeps in product(looping, self.substeps)
        ] + [
            scene.changed(settings=settings)
            for integrator in explicit
            for settings in (
                *(scene.settings.changed(integrator=integrator, substeps=substeps) for substeps in self.substeps),
                *(scene.settings.keeping(error) for error in self.errors if integrator in ESTIMATING),
            )
        ]

    def _methods(self, name: str) -> list[Any]:
        if METHODS[name] is Direct:
            return [Direct()]
        return [METHODS[name](iterations=iterations) for iterations in self.iterations]


def sweep_scene(
    scene: Scene,
    sweep: Sweep,
    device: str | None = None,
    on_row: Callable[[int, int], object] = lambda done, of: None,
    pool: Pool = ThisProcess(),  # noqa: B008 it has no state
    tick: Callable[[], object] = lambda: None,
) -> Chart:
    """Measure a scene in every configuration of a sweep that it can be simulated in.

    What is not time is measured by whoever is in the pool; then all are timed, here, one at a time on one core.

    Args:
        on_row: Called with how many are done, of how many: each configuration counts twice.
        tick: Called now and then; what it raises ends the sweep.

    Raises:
        InputError: the scene can be simulated in none of them.
    """
    frames = round(SECONDS * scene.fps)
    model = scene.builder.finalize(device, "float64")
    reference, text = _reference(scene, model, frames)
    todo = [
        (configuration, dtype)
        for configuration, dtype in product(sweep.configurations(scene), sweep.dtypes)
        if dtype != "float32" or (configuration.settings.error or np.inf) >= FLOAT32_ERROR
    ]
    judged: dict[int, Row | InputError] = {}
    for number, row in pool.run(_Judge(device, reference, frames), todo, tick):
        if isinstance(row, Lost):
            raise SimulationFailed(f"a configuration of {scene.name} has killed its worker again and again")
        judged[number] = row
        on_row(len(judged), 2 * len(todo))
    rows = []
    refusal = None
    with alone_on_a_core():
        for number, (configuration, dtype) in enumerate(todo):
            tick()
            row = judged[number]
            if isinstance(row, InputError):
                refusal = row
            else:
                rows.append(_time(row, _simulation(configuration, dtype, device), configuration, frames, sweep.repeat))
            on_row(len(todo) + number + 1, 2 * len(todo))
    if not rows:
        raise InputError(f"scene {scene.name} can be simulated in none of these configurations: {refusal}")
    info = {
        "reference": text,
        "measured": f"{frames} frames at {scene.fps:g} frames/s, {sweep.repeat} repetitions or {ENOUGH:g} s, median",
        "timed": "after all else, one at a time on one core",
        **provenance(model.device),
    }
    return Chart(tuple(rows), info)


def provenance(device: Any) -> dict[str, str]:
    """What figures were measured with: machine, versions and date, for the head of their CSV."""
    return {
        "machine": f"{platform.system()} {platform.machine()}, {_processor()}, device {device}",
        "versions": f"pbd-warp {__version__}, warp {wp.config.version}, numpy {np.__version__}, "
        f"python {platform.python_version()}",
        "date": datetime.date.today().isoformat(),
    }


def charts_folder() -> Path:
    """Where the charts that come with the project are, one CSV a scene."""
    return Path(__file__).parent / "charts"


def _reference(scene: Scene, model: Model, frames: int) -> tuple[np.ndarray, str]:
    """Positions after the last frame, and a sentence that says where they are from."""
    if scene.reference is not None:
        return scene.reference(frames / scene.fps), scene.reference_text
    finer = scene.settings.changed(substeps=FINER * scene.settings.steps_a_frame)
    try:
        finer = finer.changed(method=Direct())
        sim = Simulation(model, finer)
    except InputError:  # no paths: as many sweeps as are affordable
        finer = finer.changed(method=Jacobi(iterations=4 * scene.settings.method.iterations))
        sim = Simulation(model, finer)
    for _ in play(sim, Drag(scene.drag), frames):
        pass
    text = f"its own run with {finer.method.name}, {finer.substeps} substeps (16 times its default), float64"
    return sim.state.x.numpy(), text


def _simulation(scene: Scene, dtype: str, device: str | None) -> Simulation:
    """As far as it goes: what is off is marked in the row."""
    settings = scene.settings.changed(on_failure="continue", limits=Limits(stretch=None))
    return Simulation(scene.builder.finalize(device, dtype), settings)


@dataclass(frozen=True)
class _Judge:
    """Measures all but the time of some configurations; an InputError, such as of an integrator that does not model
    contacts, is in the place of a row."""

    device: str | None
    reference: np.ndarray
    frames: int

    def __call__(self, todo: list[tuple[Scene, str]]) -> list[Row | InputError]:
        return [self._judge(scene, dtype) for scene, dtype in todo]

    def _judge(self, scene: Scene, dtype: str) -> Row | InputError:
        try:
            sim = _simulation(scene, dtype, self.device)
        except InputError as refused:
            return InputError(str(refused))
        before = measure(sim).energy
        explicit = EXPLICIT.get(sim.settings.integrator)
        solutions = len(explicit.tableau.b) + 2 if explicit else 0  # a step: its stages, and the two that project
        stretch, iterations, most, unconverged, outcome = 0.0, 0, 0, 0, "converged"
        error = drift = float("nan")
        try:
            for _ in play(sim, Drag(scene.drag), self.frames):
                stretch = max(stretch, measure(sim).max_stretch)
                iterations += solutions * sim.substeps_used if explicit else sim.iterations_used
                most = max(most, sim.substeps_used)
                unconverged += sim.unconverged or 0
            error = float(np.sqrt(np.mean(np.sum((sim.state.x.numpy() - self.reference) ** 2, axis=1))))
            drift = measure(sim).energy - before
            rigid = not np.any(sim.model.distance.compliance > 0.0)
            if unconverged or (rigid and stretch > STRETCHED):
                outcome = "not converged"
        except SimulationFailed:
            outcome = "diverged"
        return Row(
            scene=scene.name,
            method=NO_METHOD if explicit else scene.settings.method.name,
            integrator=scene.settings.integrator,
            dtype=dtype,
            substeps=max(most, scene.settings.steps_a_frame),
            iterations=0 if explicit else scene.settings.method.iterations,
            error=scene.settings.error or 0.0,
            wall_ms_per_sim_second=float("nan"),
            wall_spread=float("nan"),
            projections_per_sim_second=_projections(sim, iterations) / SECONDS,
            position_error=error,
            max_stretch=stretch,
            energy_drift=drift,
            outcome=outcome,
        )


def _time(row: Row, sim: Simulation, scene: Scene, frames: int, repeat: int) -> Row:
    """The row with its times; one that diverged has none."""
    if row.outcome == "diverged":
        return row
    walls: list[float] = []
    while len(walls) < repeat and sum(walls) < 1e3 * ENOUGH:
        sim.reset()
        start = time.perf_counter()
        if scene.drag:
            for _ in play(sim, Drag(scene.drag), frames):
                pass
        else:
            sim.step(frames=frames)
        wp.synchronize_device(sim.model.device)
        walls.append(1e3 * (time.perf_counter() - start) / SECONDS)
    wall = statistics.median(walls)
    return replace(row, wall_ms_per_sim_second=wall, wall_spread=(max(walls) - min(walls)) / wall)


def _projections(sim: Simulation, iterations: int) -> float:
    """Constraints evaluated, counting one a particle where there are only contacts; of an explicit integrator, each
    solution of the linear equations counts as one of all of them.

    Direct counts the iterations of every piece, so its constraints are shared out among the pieces; particles alone are
    such where there are only contacts.
    """
    model = sim.model
    count = model.constraint_count or model.particle_count
    pieces = 1
    if isinstance(sim.settings.method, Direct):
        joined = model.component[model.distance.edge[:, 0]] if len(model.distance) else model.component
        pieces = len(np.unique(joined))
    return iterations * count / pieces


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or "unknown processor"
