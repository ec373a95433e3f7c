"""One cell of a map: a scene run from start to end, and its figures."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np

from pbd_warp.errors import SimulationFailed
from pbd_warp.grab.controller import play
from pbd_warp.grab.drag import Drag
from pbd_warp.measure import measure
from pbd_warp.model.model import Model
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.stability.classify import Figures
from pbd_warp.step.divergence import Limits

STEPS_A_FRAME = "substeps a frame of 1/60 s"
"""What an axis of them is called."""

EARTH = 9.81
"""Weighs what has no gravity, so that energies can be compared [m/s^2]."""

VIOLATED = 1e-5
"""A scene starts with an error if one is larger than this fraction of its size; float32 rounds by less."""


def run_scene(
    scene: Scene,
    dtype: str = "float64",
    in_line: bool = False,
    energy: bool = True,
    error: Callable[[Simulation], float] | None = None,
) -> Figures:
    """Run a scene for its frames, or until it fails.

    Args:
        in_line: Particles of one height y lie along x and must not pass through each other.
        energy: Whether energy is judged: not where a drag, or a constraint violated at the start, brings it in.
        error: What is off at the end, over the scene's size.

    Raises:
        InputError: the scene cannot be simulated with its settings.
    """
    model = scene.builder.finalize(dtype=dtype)
    # As far as it goes: nothing is rescued, and a cell is judged by its own thresholds.
    sim = Simulation(model, scene.settings, on_failure="continue", limits=Limits(stretch=None))
    measures = [measure(sim)]
    iterations = 0
    missed = stopped = False
    with np.errstate(all="ignore"):  # what flies apart overflows
        try:
            for _ in play(sim, Drag(scene.drag), scene.frames):
                measures.append(measure(sim))
                iterations += sim.iterations_used
                missed = missed or (in_line and _have_passed(model, sim))
        except SimulationFailed:
            stopped = True
            measures.append(measure(sim))
        finite = bool(np.isfinite(sim.state.x.numpy()).all())
        first, late = measures[0], measures[len(measures) // 2 :]
        gain = max(now.energy for now in late) - first.energy
        left = float("nan")
        if first.residual > VIOLATED * size_of(model):
            left = max(now.residual for now in late) / first.residual
        diameter = 2.0 * model.radius[model.radius > 0.0].min(initial=np.inf)
        return Figures(
            finite=finite,
            missed=missed,
            energy_gain=gain / _to_spend(model) if energy else float("nan"),
            stretch=max(max(now.max_stretch, now.overlap / diameter) for now in late),
            left=float("inf") if stopped and finite else left,
            error=error(sim) if error is not None and finite else float("nan"),
            iterations=iterations / max(sim.frame * sim.settings.steps_a_frame, 1),
        )


def stepped(scene: Scene, steps: float) -> Scene:
    """A scene in so many steps a frame."""
    return scene.changed(substeps=round(steps))


def study(name: str, **parameters: Any) -> Scene:
    """A scene that comes with the project, built with these parameters."""
    scene: Scene = importlib.import_module(f"pbd_warp.scenes.{name}").scene(**parameters)
    return scene


def size_of(model: Model) -> float:
    """Diagonal of the box around all particles and their radii [m]."""
    reach = model.radius[:, None]
    return float(np.linalg.norm((model.x + reach).max(axis=0) - (model.x - reach).min(axis=0)))


def _to_spend(model: Model) -> float:
    """Kinetic energy at the start, and all weight falling by the scene's size [J]."""
    mass = model.mass
    gravity = float(np.linalg.norm(model.gravity)) or EARTH
    return float(0.5 * mass @ np.sum(model.v**2, axis=1) + mass.sum() * gravity * size_of(model))


def _have_passed(model: Model, sim: Simulation) -> bool:
    """Whether two particles that began on one line (of equal y) have changed their order along x."""
    order = np.lexsort((model.x[:, 0], model.x[:, 1]))
    x, y = sim.state.x.numpy()[order, 0], model.x[order, 1]
    return bool(np.any((np.diff(x) < 0.0) & (np.diff(y) == 0.0)))
