"""Solids as triangles, for what can only draw those, and for solids that a transform makes into something else."""

from __future__ import annotations

import numpy as np

from pbd_warp.kernels.shapes import BOX, CAPSULE, CONE, SPHERE

AROUND = 48
"""Corners of a circle."""


def tessellated(kind: int, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points [m], [n, 3], and triangles [m, 3], counterclockwise seen from outside, of a box, sphere, capsule or cone
    in its frame (kernels/shapes)."""
    if kind == BOX:
        corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij")).reshape(3, 8).T * size
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        return corners, np.array([corner for a, b, c, d in quads for corner in ((a, b, c), (a, c, d))])
    quarter = np.linspace(0.0, 0.5 * np.pi, AROUND // 4 + 1)
    if kind in (SPHERE, CAPSULE):
        half = size[1] if kind == CAPSULE else 0.0
        upper = np.stack([size[0] * np.sin(quarter), half + size[0] * np.cos(quarter)], axis=1)
        profile = np.concatenate([upper, (upper * (1.0, -1.0))[::-1]])
    else:
        assert kind == CONE
        profile = np.array([[0.0, size[2]], [size[1], size[2]], [size[0], -size[2]], [0.0, -size[2]]])
    return _turned(profile)


def _turned(profile: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A line (rho, y) [n, 2] from the upper end of the y axis to its lower one, turned around it."""
    angle = 2.0 * np.pi * np.arange(AROUND) / AROUND
    rho, y = profile[1:-1].T
    rings = np.stack(
        [np.outer(rho, np.sin(angle)), np.outer(y, np.ones(AROUND)), np.outer(rho, np.cos(angle))], axis=-1
    )
    ends = np.array([[0.0, profile[0, 1], 0.0], [0.0, profile[-1, 1], 0.0]])
    ring = np.arange(rings.shape[0] * AROUND).reshape(-1, AROUND)
    following = np.roll(ring, -1, axis=1)
    top, bottom = ring.size, ring.size + 1
    parts = [
        np.stack([np.full(AROUND, top), ring[0], following[0]], axis=1),
        *(
            np.stack([a, b, c], axis=-1).reshape(-1, 3)
            for a, b, c in ((ring[:-1], ring[1:], following[1:]), (ring[:-1], following[1:], following[:-1]))
        ),
        np.stack([np.full(AROUND, bottom), following[-1], ring[-1]], axis=1),
    ]
    return np.concatenate([rings.reshape(-1, 3), ends]), np.concatenate(parts)
