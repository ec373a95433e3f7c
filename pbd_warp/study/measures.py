"""What a study measures of a finished simulation: by name, or by functions of one's own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from pbd_warp.errors import InputError, unknown
from pbd_warp.measure import CopyMeasures, measure_copies
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation

Own = Callable[[Simulation], Any]
"""A measure of one's own: a number, or a few, of a finished simulation."""

Of = Callable[[Simulation, Sequence[Scene]], np.ndarray]
"""A measure by name: of a simulation and the scene of each of its copies; shape [copy_count], or [copy_count, n]."""


def _moment(name: str) -> Of:
    return lambda sim, scenes: getattr(measure_copies(sim), name)


def _each(sim: Simulation, values: np.ndarray) -> np.ndarray:
    """By copy, from one after the other."""
    return values.reshape(sim.model.copy_count, -1, *values.shape[1:])


def _tip(sim: Simulation, scenes: Sequence[Scene]) -> np.ndarray:
    return _each(sim, sim.state.x.numpy().astype(np.float64))[:, -1]


def _tension(sim: Simulation, scenes: Sequence[Scene]) -> np.ndarray:
    return _each(sim, sim.tension)


def _reaction(sim: Simulation, scenes: Sequence[Scene]) -> np.ndarray:
    return np.linalg.norm(_each(sim, sim.reaction), axis=2)


def _position_error(sim: Simulation, scenes: Sequence[Scene]) -> np.ndarray:
    x = _each(sim, sim.state.x.numpy().astype(np.float64))
    exact = np.stack([scene.reference(sim.time) for scene in scenes if scene.reference])
    return np.sqrt(np.mean(np.sum((x - exact) ** 2, axis=2), axis=1))


NUMBERS: dict[str, Of] = {
    **{field.name: _moment(field.name) for field in fields(CopyMeasures) if "momentum" not in field.name},
    "position_error": _position_error,
}
VECTORS: dict[str, Of] = {
    "momentum": _moment("momentum"),
    "angular_momentum": _moment("angular_momentum"),
    "tip": _tip,
}
ARRAYS: dict[str, Of] = {"tension": _tension, "reaction": _reaction}

REDUCTIONS: dict[str, Callable[..., np.ndarray]] = {"max": np.max, "min": np.min, "mean": np.mean}
COMPONENTS = ("x", "y", "z")


def names() -> list[str]:
    """All that can be measured by name."""
    vectors = [f"{name}.{k}" for name in VECTORS for k in COMPONENTS]
    return [*NUMBERS, *VECTORS, *vectors, *(f"{name}.{how}" for name in ARRAYS for how in REDUCTIONS)]


def check_measures(measures: Iterable[str | Own]) -> list[str | Own]:
    """The measures, or an InputError that says what there is."""
    known, checked = names(), []
    for measure in measures:
        if isinstance(measure, str) and measure not in known:
            raise unknown("measure", measure, known)
        if not isinstance(measure, str) and not callable(measure):
            raise InputError(f"a measure is a name or a function of a finished simulation, not {measure!r}")
        checked.append(measure)
    if not checked:
        raise InputError(f"nothing is measured: there is {', '.join(known)}")
    return checked


def check_possible(measures: Iterable[str | Own], scene: Scene) -> None:
    """Raise an InputError where a scene, with its settings, has nothing of what is to be measured."""
    bases = [measure.partition(".")[0] for measure in measures if isinstance(measure, str)]
    method = scene.settings.method
    for name in ARRAYS:
        if name in bases and not method.keeps_forces:
            raise InputError(f"{name} is known with method 'direct', not with {method}")
    if "position_error" in bases and scene.reference is None:
        raise InputError(f"scene {scene.name} has no reference, so there is no position_error")


def by_name(measures: Iterable[str | Own]) -> bool:
    """Whether all are known for each copy of a replicated model; those of one's own are of one simulation."""
    return all(isinstance(measure, str) for measure in measures)


def take(sim: Simulation, scenes: Sequence[Scene], measures: Sequence[str | Own]) -> list[dict[str, float]]:
    """What was measured of each copy, by column; a vector has one column a component."""
    rows: list[dict[str, float]] = [{} for _ in scenes]
    with np.errstate(all="ignore"):
        for measure in measures:
            columns = _own(sim, measure) if callable(measure) else _columns(sim, scenes, measure)
            for name, values in columns.items():
                for row, value in zip(rows, values, strict=True):
                    row[name] = float(value)
    return rows


def _columns(sim: Simulation, scenes: Sequence[Scene], name: str) -> Mapping[str, np.ndarray]:
    if name in NUMBERS:
        return {name: NUMBERS[name](sim, scenes)}
    if name in VECTORS:
        values = VECTORS[name](sim, scenes)
        return {f"{name}.{k}": values[:, n] for n, k in enumerate(COMPONENTS)}
    base, _, how = name.rpartition(".")
    if base in VECTORS:
        return {name: VECTORS[base](sim, scenes)[:, COMPONENTS.index(how)]}
    values = ARRAYS[base](sim, scenes)
    return {name: REDUCTIONS[how](values, axis=1) if values.shape[1] else np.full(len(values), np.nan)}


def _own(sim: Simulation, measure: Own) -> Mapping[str, np.ndarray]:
    name = getattr(measure, "__name__", type(measure).__name__)
    try:
        value = np.asarray(measure(sim), np.float64)
    except Exception as error:
        raise InputError(f"measure {name} failed: {type(error).__name__}: {error}") from error
    if value.ndim == 0:
        return {name: value[None]}
    if value.ndim > 1:
        raise InputError(f"measure {name} must give a number or a few of them, not shape {list(value.shape)}")
    return {f"{name}.{k}": value[k : k + 1] for k in range(len(value))}
