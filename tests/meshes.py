"""Triangle meshes for tests: points [n, 3] and triangles [m, 3], counterclockwise seen from outside."""

import numpy as np


def grid(points):
    """Of points [rows, columns, 3]: two triangles a cell, wound so that rows x columns is outside."""
    rows, columns = points.shape[:2]
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)])
    return points.reshape(-1, 3), triangles.reshape(-1, 3)


def ball(n=24, radius=1.0):
    """Its poles are many points at one place, and triangles without area."""
    polar, around = np.meshgrid(np.linspace(0.0, np.pi, n + 1), np.linspace(0.0, 2.0 * np.pi, 2 * n + 1), indexing="ij")
    around[:, -1] = 0.0
    x = np.stack([np.sin(polar) * np.sin(around), np.cos(polar), np.sin(polar) * np.cos(around)], axis=-1)
    return grid(radius * x)


def torus(large=0.3, small=0.1, n=48, m=24):
    """Around the y axis."""
    around, across = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, n + 1), np.linspace(0.0, 2.0 * np.pi, m + 1), indexing="ij"
    )
    around[-1], across[:, -1] = 0.0, 0.0
    rho = large + small * np.cos(across)
    return grid(np.stack([rho * np.sin(around), small * np.sin(across), rho * np.cos(around)], axis=-1))


def cuboid(size=(1.0, 1.0, 1.0)):
    """Twelve triangles around the origin."""
    corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3, indexing="ij")).reshape(3, 8).T * size
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))])


def sheet(size=2.0, n=1):
    """A square in the plane y = 0, seen from above."""
    z, x = np.meshgrid(*[np.linspace(-0.5 * size, 0.5 * size, n + 1)] * 2, indexing="ij")
    return grid(np.stack([x, 0.0 * x, z], axis=-1))


def volume(points, triangles):
    """Inside of a closed mesh; negative where it is wound the other way."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(np.sum(np.einsum("ij,ij->i", a, np.cross(b, c)))) / 6.0
