"""Triangle meshes as colliders: what of them counts, and whether they are closed."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.errors import InputError

FLAT = 1e-9
"""A triangle whose height is below this part of its longest edge has no side."""

WELDED = 1e-6
"""Of a mesh's size: points nearer than this are one, or the pole of a sphere is a hole."""


def checked_mesh(points: ArrayLike, triangles: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Points [m], float64 [n, 3], and those triangles that have an area, int32 [m, 3].

    Raises:
        InputError: points that are not finite or beyond float32, triangles that are not in threes or name no point,
            no triangle with an area.
    """
    x = check.vectors("mesh: points", points)
    face = np.asarray(triangles)
    if face.size == 0:
        raise InputError("the mesh has no triangles: it needs at least one")
    if face.ndim != 2 or face.shape[1] != 3 or not np.issubdtype(face.dtype, np.integer):
        raise InputError(f"mesh: triangles must be whole numbers of shape [n, 3], not {face.dtype} {list(face.shape)}")
    bad = face[(face < 0) | (face >= len(x))]
    if bad.size:
        raise InputError(f"a triangle of the mesh names point {bad.flat[0]}, but there are {len(x)}")
    if np.abs(x).max() > 1e18:  # whose square, an area, float32 has not
        raise InputError("the mesh is too large for float32, in which nearest triangles are sought")
    face = face.astype(np.int32)
    face = face[_has_area(x, face)]
    if not len(face):
        raise InputError("no triangle of the mesh has an area")
    return x, face


def is_closed(points: np.ndarray, triangles: np.ndarray) -> bool:
    """Whether every edge is walked once in each direction, points at one place being the same point."""
    grid = np.round(points / (WELDED * np.ptp(points, axis=0).max()))
    _, number = np.unique(grid + 0.0, axis=0, return_inverse=True)
    corner = number.reshape(-1)[triangles].astype(np.int64)
    corner = corner[(corner != np.roll(corner, 1, axis=1)).all(axis=1)]
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    key = np.int64(len(points))
    there, back = np.sort(start * key + end), np.sort(end * key + start)
    return len(there) > 0 and np.array_equal(there, back) and len(np.unique(there)) == len(there)


def _has_area(x: np.ndarray, face: np.ndarray) -> np.ndarray:
    a, b, c = x[face[:, 0]], x[face[:, 1]], x[face[:, 2]]
    longest = np.max([np.sum((b - a) ** 2, axis=1), np.sum((c - b) ** 2, axis=1), np.sum((a - c) ** 2, axis=1)], axis=0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) > FLAT * longest
