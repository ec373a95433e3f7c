"""Rotations as quaternions (x, y, z, w) of unit length, as Warp has them; float64 on the host."""

from __future__ import annotations

import numpy as np

STILL = np.array([0.0, 0.0, 0.0, 1.0])
"""The one that turns nothing."""


def quaternion(vector: np.ndarray) -> np.ndarray:
    """Of a rotation vector: axis times angle [rad]."""
    angle = np.linalg.norm(vector)
    return np.append(0.5 * vector * np.sinc(0.5 * angle / np.pi), np.cos(0.5 * angle))


def after(second: np.ndarray, first: np.ndarray) -> np.ndarray:
    """First the one, then the other, shapes [..., 4]."""
    (u, a), (v, b) = (second[..., :3], second[..., 3:]), (first[..., :3], first[..., 3:])
    return np.concatenate([a * v + b * u + np.cross(u, v), a * b - np.sum(u * v, axis=-1, keepdims=True)], axis=-1)


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors turned, shapes [..., 4] and [..., 3]."""
    u = q[..., :3]
    across = np.cross(u, v)
    return v + 2.0 * (q[..., 3:] * across + np.cross(u, across))


def from_y(direction: np.ndarray) -> np.ndarray:
    """The shortest turn that takes the y axis to a direction of unit length."""
    x, y, z = direction
    if y < -1.0 + 1e-12:
        return np.array([1.0, 0.0, 0.0, 0.0])
    q = np.array([z, 0.0, -x, 1.0 + y])
    return q / np.linalg.norm(q)


def from_matrix(rows: np.ndarray) -> np.ndarray:
    """Of a proper rotation of row vectors, v @ rows."""
    m = rows.T
    # The largest of the four squares first: nothing cancels (Shepperd 1978).
    squares = np.array(
        [
            1.0 + m[0, 0] - m[1, 1] - m[2, 2],
            1.0 - m[0, 0] + m[1, 1] - m[2, 2],
            1.0 - m[0, 0] - m[1, 1] + m[2, 2],
            1.0 + np.trace(m),
        ]
    )
    columns = np.array(
        [
            [squares[0], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], squares[1], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], squares[2], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]],
        ]
    )
    q = columns[np.argmax(squares)]
    return q / np.linalg.norm(q)


def rotation_vector(q: np.ndarray) -> np.ndarray:
    """Axis times angle [rad], of at most half a turn."""
    q = -q if q[3] < 0.0 else q
    sine = float(np.linalg.norm(q[:3]))
    return q[:3] * (2.0 * np.arctan2(sine, q[3]) / sine) if sine > 0.0 else np.zeros(3)
