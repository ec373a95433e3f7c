"""What a page draws around the particles, computed from the model alone: before anything has moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from pbd_warp.drawing.solids import drawn_solids
from pbd_warp.kernels.shapes import PLANE, SPHERE
from pbd_warp.model.model import Model
from pbd_warp.usd.surroundings import flattest_axis
from pbd_warp.usd.writer import loose_edges, shown_widths

ROPE_WIDTH, EDGE_WIDTH = 0.55, 0.35
"""Of links, relative to the particles they join: the particles are seen along them."""

FLAT = 1e-6
"""A scene this much flatter than it is wide lies in a plane."""

WALL_DEPTH = 0.05
"""Of a wall in a planar scene, and half of what a plane reaches towards the eye, relative to the scene's size."""

UPRIGHT = 0.99
"""A plane is the ground where its normal points up, to within this cosine."""


def describe(model: Model) -> dict[str, Any]:
    """Everything about a model that does not change while it runs, ready for JSON.

    radius: As drawn [m]. fixed: Particles that are fixed or locked to a point. links: Pairs of particles; link_radius
    as drawn [m]; rest_length [m]. planes: Polygons of corners [m], what is free of the other planes; of a planar scene
    they are seen from their edges, and walls are polygons in its plane behind them. spheres: [x, y, z, radius] each, at
    rest. solids: All other colliders, see `DrawnSolid`. low, high: The box in which motion is to be expected [m].
    ground: Height of a plane that things lie on [m], None where there is none. axis: To look along, 0 to 2, where the
    scene is planar, otherwise None.
    """
    radius = 0.5 * shown_widths(model)
    edge = model.distance.edge
    width = np.where(loose_edges(model), EDGE_WIDTH, ROPE_WIDTH)
    fixed = model.w == 0.0
    fixed[model.point.particle] = True
    low, high = expected_box(model, radius)
    axis = flat_axis(model)
    colliders = model.colliders
    ball, flat = (colliders.kind == SPHERE) & (colliders.moves == 0), colliders.kind == PLANE
    centre, normal = colliders.centre[flat], colliders.size[flat]
    planes = plane_polygons(centre, normal, low, high, axis)
    level = centre[normal[:, 1] > UPRIGHT, 1]
    return {
        "radius": radius.tolist(),
        "fixed": np.flatnonzero(fixed).tolist(),
        "links": edge.tolist(),
        "link_radius": (width * radius[edge].min(axis=1)).tolist(),
        "rest_length": model.distance.rest_length.tolist(),
        "planes": [polygon.tolist() for polygon, _ in planes],
        "walls": [wall(polygon, n, low, high, axis).tolist() for polygon, n in planes if axis is not None],
        "solids": [solid.to_json() for solid in drawn_solids(model)],
        "spheres": np.column_stack([colliders.centre[ball], colliders.size[ball, 0]]).tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
        "ground": float(level.max()) if len(level) and axis is None else None,
        "axis": axis,
    }


def flat_axis(model: Model) -> int | None:
    """The axis along which nothing extends or moves at the start, None where there is none."""
    size = np.ptp(model.x, axis=0)
    axis = flattest_axis(size)
    still = not np.any(model.v[:, axis]) and model.gravity[axis] == 0.0
    return axis if still and size[axis] <= FLAT * max(size.max(), 1e-3) else None


def expected_box(model: Model, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The box [m] of the initial state, and of where pieces that hang from one particle can swing."""
    reach = radius[:, None]
    low, high = (model.x - reach).min(axis=0), (model.x + reach).max(axis=0)
    anchored = model.w == 0.0
    anchored[model.point.particle] = True
    flat = flat_axis(model)
    falls = float(np.linalg.norm(model.gravity)) > 0.0
    for piece in np.unique(model.component[anchored]):
        members = model.component == piece
        anchors = np.flatnonzero(members & anchored)
        if len(anchors) != 1:
            continue
        pin = model.x[anchors[0]]
        swing = np.full(3, np.linalg.norm(model.x[members] - pin, axis=1).max())
        if flat is not None:
            swing[flat] = 0.0
        up = swing * ~(falls & (np.arange(3) == 1))  # what falls comes back no higher than it was
        low, high = np.minimum(low, pin - swing), np.maximum(high, pin + up)
    return low, high


def plane_polygons(
    point: np.ndarray, normal: np.ndarray, low: np.ndarray, high: np.ndarray, flat: int | None
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Each plane as the polygon [m], [corners, 3], that bounds the free space around a box, and its normal; a plane
    that is wholly behind others has none."""
    centre, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    slabs = (
        []
        if flat is None
        else [(s * np.eye(3)[flat], centre - s * WALL_DEPTH * size * np.eye(3)[flat]) for s in (1, -1)]
    )
    polygons = []
    for number, (p, n) in enumerate(zip(point, normal, strict=True)):
        foot = centre - n * ((centre - p) @ n)
        across = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        across /= np.linalg.norm(across)
        along = np.cross(n, across)
        polygon = foot + size * np.array([across + along, along - across, -across - along, across - along])
        others = [(normal[k], point[k]) for k in range(len(point)) if k != number]
        for cut_normal, cut_point in [*others, *slabs]:
            polygon = _clip(polygon, (polygon - cut_point) @ cut_normal)
        if len(polygon):
            polygons.append((polygon, n))
    return polygons


def wall(polygon: np.ndarray, normal: np.ndarray, low: np.ndarray, high: np.ndarray, axis: int) -> np.ndarray:
    """The band [m], [4, 3], in the plane of a planar scene that lies behind a plane's polygon. It goes on at both ends,
    so that the walls of a box meet; what is beyond them is behind another wall."""
    along = np.cross(normal, np.eye(3)[axis])
    depth = WALL_DEPTH * float(np.linalg.norm(high - low))
    ends = polygon[[np.argmin(polygon @ along), np.argmax(polygon @ along)]] + depth * np.outer([-1, 1], along)
    ends[:, axis] = 0.5 * (low + high)[axis]
    return np.concatenate([ends, ends[::-1] - depth * normal])


def _clip(polygon: np.ndarray, height: np.ndarray) -> np.ndarray:
    """The part of a convex polygon where the height is not negative (Sutherland and Hodgman 1974)."""
    kept = []
    for a, b, ha, hb in zip(polygon, np.roll(polygon, -1, axis=0), height, np.roll(height, -1), strict=True):
        if ha >= 0.0:
            kept.append(a)
        if (ha < 0.0) != (hb < 0.0):
            kept.append(a + (b - a) * (ha / (ha - hb)))
    return np.array(kept).reshape(-1, 3)
