"""Many models of one graph as one, so that a launch makes a step of all of them.

Copies lie one after the other: those of copy k begin at k times the particles (and constraints) of one. No constraint
joins two of them and no contact is found between them, so each moves as it would alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from pbd_warp.errors import InputError, unknown
from pbd_warp.model.bending import BendingSet, lengths_of
from pbd_warp.model.constraints import DistanceSet, PointSet, check_softness
from pbd_warp.model.model import Model

VARYING = ("positions", "velocity", "mass", "radius", "rest_length", "stiffness", "compliance")
"""What may differ from copy to copy, named as the builder's methods name it."""

OF_EDGES = VARYING[4:]


def check_varying(n: int, particle_count: int, edge_count: int, values: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Values that vary by copy, each broadcast to [n, particle_count or edge_count], vectors to [n, ..., 3].

    Raises:
        InputError: an unknown name, a shape that does not fit, a value out of range.
    """
    checked = {}
    for name, value in values.items():
        if name not in VARYING:
            raise unknown("value that varies by copy", name, VARYING)
        count = edge_count if name in OF_EDGES else particle_count
        shape = (n, count, 3) if name in ("positions", "velocity") else (n, count)
        try:
            array = np.broadcast_to(np.asarray(value, np.float64), shape)
        except (TypeError, ValueError):
            raise InputError(
                f"{name} of {n} copies must be numbers of shape {list(shape)}, or [{n}, 1] for one a copy, "
                f"not {list(np.shape(value))}"
            ) from None
        low = -np.inf if len(shape) == 3 else 0.0
        high = 1.0 if name == "stiffness" else np.inf
        wrong = np.argwhere(~np.isfinite(array) | (array < low) | (array > high) | ((name == "mass") & (array == 0.0)))
        if len(wrong):
            copy, number = wrong[0][:2]
            raise InputError(
                f"{name} of copy {copy} must be finite{'' if len(shape) == 3 else ' and not negative'}"
                f"{', at most 1' if name == 'stiffness' else ', and not 0' if name == 'mass' else ''}: "
                f"number {number} is {array[tuple(wrong[0])]:g}"
            )
        checked[name] = array
    return checked


def replicate(model: Model, n: int, varying: Mapping[str, Any]) -> Model:
    """n copies of a model as one, see `ModelBuilder.replicate`. A fixed particle is fixed in every copy."""
    values = check_varying(n, model.particle_count, len(model.distance), varying)
    changes: dict[str, np.ndarray] = {}
    if "positions" in values:
        changes["x"] = values["positions"]
    if "velocity" in values:
        changes["v"] = np.where((model.w > 0.0)[:, None], values["velocity"], 0.0)
    if "mass" in values:
        changes["w"] = np.where(model.w > 0.0, 1.0 / values["mass"], 0.0)
    if "radius" in values:
        changes["radius"] = values["radius"]
    soft = {name: values[name] for name in values if name in OF_EDGES}
    return _replicate(model, n, changes, soft, {}, {})


def join(models: list[Model]) -> Model:
    """Models of one graph, each a copy of the result.

    Raises:
        InputError: they differ in more than the values that may vary.
    """
    first = models[0]
    if any(graph_of(model) != graph_of(first) for model in models[1:]):
        raise InputError("only models of the same graph can be joined as copies")

    def stack(of: str, names: tuple[str, ...]) -> dict[str, np.ndarray]:
        parts = [getattr(model, of) if of else model for model in models]
        return {name: np.stack([getattr(part, name) for part in parts]) for name in names}

    return _replicate(
        first,
        len(models),
        stack("", ("x", "v", "w", "radius")),
        stack("distance", ("rest_length", "stiffness", "compliance")),
        stack("point", ("target", "stiffness", "compliance")),
        stack("bending", ("stiffness", "rest")),
    )


def graph_of(model: Model) -> bytes:
    """Everything about a model that all its copies share, as a key that is equal where it is the same."""
    pinned = model.w == 0.0
    # What a method binds only where something is compliant belongs to the graph too.
    soft = (model.distance.compliance > 0.0, model.point.compliance > 0.0)
    colliders = [getattr(model.colliders, field.name) for field in fields(model.colliders)]
    arrays = [model.gravity, pinned, model.distance.edge, model.point.particle, model.bending.triple]
    arrays += [*soft, *colliders, *model.ropes]
    head = repr((model.contacts, model.dtype, str(model.device), [a.shape for a in arrays]))
    return head.encode() + b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)


def copy_of(model: Model, k: int) -> Model:
    """Copy k of a replicated model as a model by itself."""
    return replace(
        model,
        x=_part(model, model.x, k),
        v=_part(model, model.v, k),
        w=_part(model, model.w, k),
        radius=_part(model, model.radius, k),
        distance=DistanceSet(
            _part(model, model.distance.edge, 0),
            *(_part(model, getattr(model.distance, name), k) for name in ("rest_length", "stiffness", "compliance")),
        ),
        point=PointSet(
            _part(model, model.point.particle, 0),
            *(_part(model, getattr(model.point, name), k) for name in ("target", "stiffness", "compliance")),
        ),
        bending=BendingSet(
            _part(model, model.bending.triple, 0),
            *(_part(model, getattr(model.bending, name), k) for name in ("stiffness", "length", "rest")),
        ),
        ropes=model.ropes[: len(model.ropes) // model.copy_count],
        component=_part(model, model.component, 0),
        copy_count=1,
    )


def _part(model: Model, array: np.ndarray, k: int) -> np.ndarray:
    return array.reshape(model.copy_count, -1, *array.shape[1:])[k]


def _replicate(
    model: Model,
    n: int,
    changes: dict[str, np.ndarray],
    soft: dict[str, np.ndarray],
    points: dict[str, np.ndarray],
    bends: dict[str, np.ndarray],
) -> Model:
    """Copies with values [n, ...] in place of those of the model."""

    def flat(array: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(array).reshape(-1, *array.shape[2:])

    def values(part: Any, name: str, given: Mapping[str, np.ndarray]) -> np.ndarray:
        array = getattr(part, name)
        return flat(given[name]) if name in given else np.tile(array, (n, *[1] * (array.ndim - 1)))

    def numbers(index: np.ndarray, step: int) -> np.ndarray:
        """Indices of every copy."""
        shift = np.arange(n, dtype=np.int64).reshape(n, *[1] * index.ndim) * step
        return flat(index[None] + shift).astype(np.int32)

    distance = DistanceSet(
        numbers(model.distance.edge, model.particle_count),
        *(values(model.distance, name, soft) for name in ("rest_length", "stiffness", "compliance")),
    )
    check_softness("a distance", distance.stiffness, distance.compliance)
    point = PointSet(
        numbers(model.point.particle, model.particle_count),
        *(values(model.point, name, points) for name in ("target", "stiffness", "compliance")),
    )
    triple = numbers(model.bending.triple, model.particle_count)
    bending = BendingSet(
        triple,
        values(model.bending, "stiffness", bends),
        lengths_of(triple, distance.edge, distance.rest_length),
        values(model.bending, "rest", bends),
    )
    x, v = values(model, "x", changes), values(model, "v", changes)
    with np.errstate(over="ignore"):
        too_large = not np.isfinite(np.concatenate([x, v]).astype(model.dtype)).all()
    if too_large:
        raise InputError(f"a position or velocity of a copy is too large a number for {model.dtype}")
    return replace(
        model,
        x=x,
        v=v,
        w=values(model, "w", changes),
        radius=values(model, "radius", changes),
        distance=distance,
        point=point,
        bending=bending,
        ropes=tuple(rope + np.int32(k * model.particle_count) for k in range(n) for rope in model.ropes),
        component=numbers(model.component, int(model.component.max()) + 1),
        copy_count=n,
    )
