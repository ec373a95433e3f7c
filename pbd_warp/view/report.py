"""What pages are told of a session: of a scene once, and figures all the time."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from pbd_warp.cost import cost_sheet
from pbd_warp.drawing.surroundings import describe
from pbd_warp.errors import InputError
from pbd_warp.measure import measure
from pbd_warp.scene import scene_parameters, scene_summary, scene_text
from pbd_warp.simulation import Simulation
from pbd_warp.step.integrators import INTEGRATORS
from pbd_warp.step.methods import METHODS
from pbd_warp.view.changes import CHANGES, in_force
from pbd_warp.view.remedies import remedies
from pbd_warp.view.session import Session


def description(session: Session) -> dict[str, Any]:
    """A scene, ready for JSON.

    scenes: By name what can be opened: a summary, what is said of the parameters, and their defaults. parameters: Those
    of this one that are not the defaults. plots: Names of the figures in `status` that this scene has. The rest is
    that of `describe`.
    """
    scene, model = session.scene, session.model
    seed, parameters = session.made_from
    if seed is not None:
        parameters = {**parameters, "seed": str(seed)}
    plots = ["kinetic", "ms"]
    if np.any(model.gravity) or np.any(model.distance.compliance) or np.any(model.point.compliance):
        plots += ["energy", "potential"]
    if np.any(model.distance.rest_length > 0.0):
        plots.append("max_stretch")
    if len(model.distance) or len(model.point) or model.collides:
        plots.append("residual")
    return {
        "generation": session.generation,
        "scene": scene.name,
        "parameters": parameters,
        "scenes": {name: _choice(source) for name, source in sorted(session.sources.items())},
        "methods": list(METHODS),
        "integrators": list(INTEGRATORS),
        "fps": scene.fps,
        "plots": plots,
        **describe(model),
    }


def status(session: Session) -> dict[str, Any]:
    """Figures of this moment. None is what is not finite, or not there.

    first: The earliest frame that one can go back to; last: the newest. kept: Frames kept so far. iterations: Of the
    last frame, where the method decides how many there are. has_tension: Whether frames come with tensions. warnings:
    What is known to fail (`Simulation.check`).
    """
    sim, settings = session.sim, session.settings
    with np.errstate(all="ignore"):
        now = measure(sim)
    decides = sim.unconverged is not None
    return {
        "frame": session.frame,
        "time": session.frame * sim.dt,
        "first": session.frames.first,
        "last": session.frames.last,
        "kept": session.kept,
        "paused": session.paused,
        "failure": session.failure,
        "remedies": remedies(session.failure or "", settings, session.dtype),
        "warnings": _warnings(sim),
        "ms": 1e3 * session.seconds,
        "max_stretch": _finite(now.max_stretch),
        "residual": _finite(now.residual),
        "energy": _finite(now.energy),
        "kinetic": _finite(now.kinetic),
        "potential": _finite(now.energy - now.kinetic),
        "iterations": sim.iterations_used if decides else None,
        "has_tension": sim.keeps_forces and len(sim.model.distance) > 0,
        "unconverged": sim.unconverged if decides else None,
        "settings": {
            **{name: value for name, value in in_force(settings).items() if name in CHANGES},
            "stiffness": _stiffness(sim),
            "gravity": sim.model.gravity.tolist(),
            "dtype": session.dtype,
        },
        "cost": _cost(sim),
    }


@lru_cache(maxsize=64)
def _choice(source: str) -> dict[str, Any]:
    """A scene that can be opened; one that was made in a program has no file, and so no parameters."""
    try:
        summary = "" if source.endswith(".py") else scene_summary(source)
        return {"summary": summary, "text": scene_text(source), "parameters": scene_parameters(source)}
    except InputError:
        return {"summary": "", "text": "", "parameters": {}}


@lru_cache(maxsize=1)
def _cost(sim: Simulation) -> str:
    return cost_sheet(sim)


@lru_cache(maxsize=1)
def _warnings(sim: Simulation) -> list[dict[str, Any]]:
    return [{"text": str(one), "remedies": remedies(one.remedy, sim.settings, sim.model.dtype)} for one in sim.check()]


def _stiffness(sim: Simulation) -> float | None:
    """Of all distances, None where they differ."""
    stiffness = np.unique(sim.model.distance.stiffness)
    return float(stiffness[0]) if len(stiffness) == 1 else None


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
