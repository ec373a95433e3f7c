"""A model as named arrays and back, for files and digests."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.kernels.shapes import KINDS, MESH
from pbd_warp.model.bending import BendingSet, lengths_of
from pbd_warp.model.builder import DTYPES
from pbd_warp.model.colliders import Colliders
from pbd_warp.model.constraints import DistanceSet, PointSet, check_capsules, check_softness
from pbd_warp.model.graph import components
from pbd_warp.model.meshes import checked_mesh
from pbd_warp.model.model import Contacts, Model

Take = Callable[..., np.ndarray]


def flat_arrays(model: Model) -> Iterator[tuple[str, np.ndarray]]:
    """Its arrays by name."""
    for field in fields(model):
        value = getattr(model, field.name)
        if field.name == "bending" and not len(value):
            continue  # as files of a time before it are
        if is_dataclass(value):
            for inner in fields(value):
                if field.name == "contacts" and inner.name == "links":
                    continue
                yield f"{field.name}.{inner.name}", np.asarray(getattr(value, inner.name))
        elif isinstance(value, np.ndarray):
            yield field.name, value
    yield "ropes", np.concatenate([np.zeros(0, np.int32), *model.ropes])
    yield "rope_lengths", np.array([len(rope) for rope in model.ropes], int)
    if model.contacts and model.contacts.links:
        yield "contacts.links", np.array(1)
    if model.copy_count > 1:
        yield "copy_count", np.array(model.copy_count)


def model_from(arrays: Mapping[str, np.ndarray], device: Any, dtype: str) -> Model:
    """The model of these arrays.

    Raises:
        InputError: one is missing, one too many, or holds what no builder would have put there.
    """
    flat = dict(arrays)

    def take(name: str, shape: tuple[int, ...], kind: type = np.float64) -> np.ndarray:
        if name not in flat:
            raise InputError(f"there is no {name}")
        values = flat.pop(name)
        if values.dtype != kind or values.shape != shape:
            raise InputError(f"{name} is {values.dtype} {list(values.shape)}, not {np.dtype(kind)} {list(shape)}")
        if kind is np.float64 and not np.isfinite(values).all():
            raise InputError(f"{name} is not finite")
        return values

    def rows(name: str) -> int:
        return len(flat[name]) if name in flat and flat[name].ndim else 0

    def in_range(name: str, shape: tuple[int, ...], count: int) -> np.ndarray:
        return check.indices(name, take(name, shape, np.int32), count)

    def within(name: str, shape: tuple[int, ...], high: float = np.inf) -> np.ndarray:
        values = take(name, shape)
        if np.any(values < 0.0) or np.any(values > high):
            raise InputError(f"{name} has values out of range")
        return values

    n, edges, points = rows("x"), rows("distance.edge"), rows("point.particle")
    if n == 0:
        raise InputError("there are no particles")
    distance = DistanceSet(
        in_range("distance.edge", (edges, 2), n),
        within("distance.rest_length", (edges,)),
        within("distance.stiffness", (edges,), 1.0),
        within("distance.compliance", (edges,)),
    )
    point = PointSet(
        in_range("point.particle", (points,), n),
        take("point.target", (points, 3)),
        within("point.stiffness", (points,), 1.0),
        within("point.compliance", (points,)),
    )
    check_softness("a distance", distance.stiffness, distance.compliance)
    check_softness("a point", point.stiffness, point.compliance)
    if np.any(distance.edge[:, 0] == distance.edge[:, 1]):
        raise InputError("distance.edge joins a particle to itself")
    bending = _bending(flat, take, in_range, distance)
    contacts = None
    if "contacts.friction" in flat:
        contacts = Contacts(
            float(within("contacts.friction", ())),
            float(within("contacts.restitution", (), 1.0)),
            "contacts.links" in flat and bool(take("contacts.links", (), np.int64)),
        )
    radius = within("radius", (n,))
    if contacts and contacts.links:
        check_capsules(distance, radius)
    lengths = take("rope_lengths", (rows("rope_lengths"),), np.int64)
    along = in_range("ropes", (rows("ropes"),), n)
    if np.any(lengths < 1) or lengths.sum() != len(along):
        raise InputError("ropes and rope_lengths do not fit")
    copies = int(take("copy_count", (), np.int64)) if "copy_count" in flat else 1
    if copies < 1 or n % copies or edges % copies or points % copies:
        raise InputError("copy_count does not divide the model into equal parts")
    model = Model(
        gravity=take("gravity", (3,)),
        x=take("x", (n, 3)),
        v=take("v", (n, 3)),
        w=within("w", (n,)),
        radius=radius,
        distance=distance,
        point=point,
        bending=bending,
        contacts=contacts,
        colliders=_colliders(rows, take, in_range, within),
        ropes=tuple(np.split(along, np.cumsum(lengths)[:-1])) if len(lengths) else (),
        component=take("component", (n,), np.int32),
        device=device,
        real=DTYPES[dtype],
        copy_count=copies,
    )
    if flat:
        raise InputError(f"{next(iter(flat))} is no part of a model")
    if not np.array_equal(model.component, components(distance.edge, n)):
        raise InputError("component is not that of the distances")
    return model


def _colliders(rows: Callable, take: Callable, in_range: Callable, within: Callable) -> Colliders:
    """The part of `model_from` for colliders; its arguments are the readers there."""
    count, points, triangles = rows("colliders.kind"), rows("colliders.points"), rows("colliders.triangles")
    made = Colliders(
        in_range("colliders.kind", (count,), KINDS),
        take("colliders.centre", (count, 3)),
        take("colliders.rotation", (count, 4)),
        take("colliders.size", (count, 3)),
        within("colliders.friction", (count,)),
        within("colliders.restitution", (count,), 1.0),
        in_range("colliders.moves", (count,), 2),
        take("colliders.velocity", (count, 3)),
        take("colliders.spin", (count, 3)),
        take("colliders.points", (points, 3)),
        take("colliders.triangles", (triangles, 3), np.int32),
        in_range("colliders.point_count", (count,), points + 1),
        in_range("colliders.triangle_count", (count,), triangles + 1),
    )
    if np.any(np.abs(np.linalg.norm(made.rotation, axis=1) - 1.0) > 1e-6):
        raise InputError("colliders.rotation holds what turns nothing rightly")
    if made.point_count.sum() != points or made.triangle_count.sum() != triangles:
        raise InputError("colliders.points and colliders.triangles do not fit")
    for which in np.flatnonzero(made.kind == MESH).tolist():
        checked_mesh(*made.mesh(which))
    return made


def _bending(flat: Mapping[str, np.ndarray], take: Take, in_range: Take, distance: DistanceSet) -> BendingSet:
    """What resists bending; nothing where a file has none."""
    if "bending.triple" not in flat:
        return BendingSet(np.zeros((0, 3), np.int32), np.zeros(0), np.zeros(0), np.zeros(0))
    count = len(flat["bending.triple"]) if flat["bending.triple"].ndim else 0
    triple = in_range("bending.triple", (count, 3), len(flat["x"]))
    stiffness, length, rest = (take(f"bending.{name}", (count,)) for name in ("stiffness", "length", "rest"))
    if np.any(stiffness <= 0.0) or np.any(length <= 0.0) or np.any(rest < 0.0):
        raise InputError("bending.stiffness, bending.length or bending.rest has values out of range")
    lengths_of(triple, distance.edge, distance.rest_length)
    return BendingSet(triple, stiffness, length, rest)
