"""Largest eigenvalues by power iteration: of a Jacobi sweep on a graph, and of its springs."""

from __future__ import annotations

import numpy as np

from pbd_warp.model.model import Model
from pbd_warp.step.methods.jacobi import Jacobi

ITERATIONS = 200
"""The estimate comes from below. On a chain, whose eigenvalues lie closest, it is within 0.1 % of 2 cos^2(pi/(2 N))."""


def largest_eigenvalue(model: Model, method: Jacobi, x: np.ndarray | None = None) -> float:
    """lambda_max of D^-1 A at positions x [particle_count, 3] (the initial ones unless given): a sweep multiplies the
    error by 1 - relaxation * lambda, so it converges for relaxation < 2 / lambda_max.

    A = J W J^T over all distances and points, D what the method divides by (see `Jacobi.averaging`); stiffness and
    compliance, which only help, are left out. 0 where there are no constraints that can move anything.
    """
    x = model.x if x is None else x
    edges, points = model.distance, model.point
    i, j = edges.edge.T
    d = x[i] - x[j]
    length = np.linalg.norm(d, axis=1, keepdims=True)
    n = np.divide(d, length, out=np.tile([1.0, 0.0, 0.0], (len(d), 1)), where=length > 0.0)
    w = model.w
    count = np.maximum(method.valence(model), 1).astype(np.float64)
    share = count if method.averaging == "mass-splitting" else np.ones_like(count)
    moves = w / count if method.averaging == "valence" else w
    weight = share[i] * w[i] + share[j] * w[j]
    scale = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0.0)
    p = points.particle
    point_weight = share[p] * w[p]
    point_scale = np.divide(1.0, point_weight, out=np.zeros_like(point_weight), where=point_weight > 0.0)

    u = np.random.default_rng(0).normal(size=x.shape) * (w[:, None] > 0.0)
    value = 0.0
    for _ in range(ITERATIONS):
        size = np.linalg.norm(u)
        if size == 0.0:
            return 0.0
        u /= size
        dlam = scale[:, None] * np.sum(n * (u[i] - u[j]), axis=1, keepdims=True) * n
        change = np.zeros_like(u)
        np.add.at(change, i, dlam)
        np.subtract.at(change, j, dlam)
        np.add.at(change, p, point_scale[:, None] * u[p])
        u = moves[:, None] * change
        value = float(np.linalg.norm(u))
    return value


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
