"""How fast springs swing, which an explicit step has to follow."""

from __future__ import annotations

import numpy as np

ITERATIONS = 200
"""Of the power iteration, which comes from below: on a chain of equal springs within 0.1 %."""


def stiffest(x: np.ndarray, w: np.ndarray, edge: np.ndarray, compliance: np.ndarray) -> float:
    """The largest omega^2 [1/s^2] of springs between particles at x [n, 3] with inverse masses w [n]: the largest
    eigenvalue of J W J^T / compliance. Rigid distances between the same particles only make it less."""
    i, j = edge.T
    d = x[i] - x[j]
    length = np.linalg.norm(d, axis=1, keepdims=True)
    n = np.divide(d, length, out=np.tile([1.0, 0.0, 0.0], (len(d), 1)), where=length > 0.0)
    stretch = np.random.default_rng(0).normal(size=len(edge))
    value = 0.0
    for _ in range(ITERATIONS):
        size = np.linalg.norm(stretch)
        if size == 0.0:
            return 0.0
        force = (stretch / (size * compliance))[:, None] * n
        a = np.zeros_like(x)
        np.add.at(a, i, force)
        np.subtract.at(a, j, force)
        a *= w[:, None]
        stretch = np.sum(n * (a[i] - a[j]), axis=1)
        value = float(np.linalg.norm(stretch))
    return value
