"""What a prim is made of, in its own space: a plane, a solid or triangles."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from pxr import Usd, UsdGeom

from pbd_warp import check
from pbd_warp.curves.attributes import changes
from pbd_warp.errors import InputError
from pbd_warp.kernels.shapes import BOX, CAPSULE, CONE, MESH, PLANE, SPHERE
from pbd_warp.model.rotation import from_y, rotate
from pbd_warp.model.tessellation import tessellated

TYPES = ("Mesh", "Cube", "Sphere", "Cylinder", "Cone", "Capsule", "Plane")
"""Of prims that curves can collide with."""

AXES = {"X": 0, "Y": 1, "Z": 2}


@dataclass(frozen=True)
class Solid:
    """kind: Of kernels/shapes; size: as there, along `axis` instead of y. middle: Where its origin is. points, faces:
    Of a mesh."""

    kind: int
    size: np.ndarray
    axis: np.ndarray
    middle: np.ndarray = field(default_factory=lambda: np.zeros(3))
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), int))

    def triangles(self) -> tuple[np.ndarray, np.ndarray]:
        """Points [n, 3] and triangles [m, 3]."""
        if self.kind == MESH:
            return self.points, self.faces
        points, faces = tessellated(self.kind, self.size)
        return rotate(from_y(self.axis), points), faces


def solid_of(prim: Usd.Prim, time_codes: np.ndarray) -> Solid:
    """What the prim is at the first frame.

    Raises:
        InputError: it is of none of these types, its numbers make no sense, or they change with time.
    """
    name = prim.GetTypeName()
    if name not in TYPES:
        raise InputError(f"it is a {name}, which is not supported as a collider: there is {', '.join(TYPES)}")
    if name == "Mesh":
        return _mesh(UsdGeom.Mesh(prim), time_codes)

    def number(attribute: str) -> float:
        return check.number(attribute, _now(prim.GetAttribute(attribute), time_codes), above=0.0)

    axis = np.zeros(3)
    if name not in ("Cube", "Sphere"):
        token = _now(prim.GetAttribute("axis"), time_codes)
        if token not in AXES:
            raise InputError(f"its axis must be X, Y or Z, not {token!r}")
        axis[AXES[token]] = 1.0
    if name == "Plane":
        return Solid(PLANE, axis, axis)
    if name == "Sphere":
        return Solid(SPHERE, np.array([number("radius"), 0.0, 0.0]), axis)
    if name == "Cube":
        return Solid(BOX, np.full(3, 0.5 * number("size")), axis)
    radius, half = number("radius"), 0.5 * number("height")
    if name == "Capsule":
        return Solid(CAPSULE, np.array([radius, half, 0.0]), axis)
    return Solid(CONE, np.array([radius, radius if name == "Cylinder" else 0.0, half]), axis)


def _mesh(mesh: UsdGeom.Mesh, time_codes: np.ndarray) -> Solid:
    points = check.vectors("points", _now(mesh.GetPointsAttr(), time_codes) or [])
    counts = np.array(_now(mesh.GetFaceVertexCountsAttr(), time_codes) or [], int)
    corners = np.array(_now(mesh.GetFaceVertexIndicesAttr(), time_codes) or [], int)
    holes = np.array(_now(mesh.GetHoleIndicesAttr(), time_codes) or [], int)
    if np.any(counts < 0) or counts.sum() != len(corners):
        raise InputError(f"faceVertexCounts add up to {counts.sum()}, but there are {len(corners)} faceVertexIndices")
    first = np.cumsum(counts) - counts
    solid = np.ones(len(counts), bool)
    solid[holes[(holes >= 0) & (holes < len(counts))]] = False
    # Each face as a fan from its first corner.
    face = np.repeat(np.arange(len(counts)), np.where(solid, np.maximum(counts - 2, 0), 0))
    step = np.arange(len(face)) - np.searchsorted(face, face)
    faces = corners[np.stack([first[face], first[face] + step + 1, first[face] + step + 2], axis=1)]
    if mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded:
        faces = faces[:, ::-1]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0)) if len(points) else np.zeros(3)
    return Solid(MESH, np.zeros(3), np.zeros(3), middle, points, faces)


def _now(attribute: Usd.Attribute, time_codes: np.ndarray) -> object:
    if changes(attribute, time_codes):
        raise InputError(f"its {attribute.GetName()} change with time, and colliders keep their form")
    return attribute.Get(float(time_codes[0]))
