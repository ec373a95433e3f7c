"""What a strand cannot change without passing through one: linking number and writhe, exact for polygons.

Both are Gauss's integral over pairs of segments, each of which sees the other under a solid angle (Klenin and Langowski
2000, Computation of writhe in modeling of supercoiled DNA, method 1a).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pbd_warp import check


def linking_number(a: ArrayLike, b: ArrayLike) -> float:
    """How often two closed curves go through each other: a whole number, to round-off, where they do not touch.

    Args:
        a, b: Their points in order [m], shape [n, 3]; the last is joined to the first.
    """
    one, other = (_closed(check.vectors(name, points)) for name, points in (("a", a), ("b", b)))
    i = np.repeat(np.arange(len(one) - 1), len(other) - 1)
    j = np.tile(np.arange(len(other) - 1), len(one) - 1)
    return float(_angles(one[i], one[i + 1], other[j], other[j + 1]).sum() / (4.0 * np.pi))


def writhe(points: ArrayLike, closed: bool = False) -> float:
    """How much a curve coils about itself; it changes by 2 where one strand of it passes through another.

    Args:
        points: In order [m], shape [n, 3].
    """
    x = check.vectors("points", points)
    x = _closed(x) if closed else x
    i, j = np.triu_indices(len(x) - 1, 2)
    if closed:  # the last segment ends where the first begins: neighbours see nothing of each other
        apart = (i > 0) | (j < len(x) - 2)
        i, j = i[apart], j[apart]
    return float(_angles(x[i], x[i + 1], x[j], x[j + 1]).sum() / (2.0 * np.pi))


def _closed(x: np.ndarray) -> np.ndarray:
    return np.concatenate([x, x[:1]])


def _angles(p: np.ndarray, q: np.ndarray, r: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Signed solid angles under which the segments p q and r s see each other, [n]."""
    sides = [np.cross(u, v) for u, v in ((r - p, s - p), (s - p, s - q), (s - q, r - q), (r - q, r - p))]
    sides = [side / np.maximum(np.linalg.norm(side, axis=1), 1e-300)[:, None] for side in sides]
    turns = [np.arcsin(np.clip(np.sum(sides[k - 1] * sides[k], axis=1), -1.0, 1.0)) for k in range(4)]
    return np.sum(turns, axis=0) * np.sign(np.sum(np.cross(s - r, q - p) * (r - p), axis=1))
