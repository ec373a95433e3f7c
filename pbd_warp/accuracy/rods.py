"""Known answers of elastic rods that bend in a plane, in float64. NumPy and SciPy only: nothing here calls a kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

TOLERANCE = {"rtol": 1e-11, "atol": 1e-13}


def elastica(
    s: ArrayLike,
    length: float,
    bending: float,
    force: ArrayLike = (0.0, 0.0),
    weight: ArrayLike = (0.0, 0.0),
    angle: float = 0.0,
    curvature: float = 0.0,
    tip: tuple[float, float] = (-np.pi / 2.0, np.pi / 2.0),
) -> np.ndarray:
    """A rod clamped at the origin, as far bent as it will (Euler's elastica), by shooting.

    With theta the angle of the tangent, n what the part beyond pulls with and m the moment,

        n(s) = force + weight (length - s),  m' = -(cos theta n_y - sin theta n_x),  B (theta' - curvature) = m

    theta(0) = angle, m(length) = 0. From the tip back, for that angle of the tip for which theta(0) fits.

    Args:
        s: Where along the rod [m], shape [n]; what lies before the clamp counts as in it.
        length: [m]. bending: B [N m^2]. force: at the tip [N]. weight: of a metre [N/m].
        angle: At the clamp [rad]. curvature: Of the rod without load [1/m].
        tip: Angles of the tip between which the one that is sought lies [rad].

    Returns:
        [m], shape [n, 3], in the plane z = 0.
    """
    force, weight = np.asarray(force, float), np.asarray(weight, float)

    def rate(t: float, state: np.ndarray) -> list[float]:
        """Against t = length - s."""
        theta, m = state[:2]
        n = force + weight * t
        turn = np.cos(theta) * n[1] - np.sin(theta) * n[0]
        return [-(m / bending + curvature), turn, -np.cos(theta), -np.sin(theta)]

    def shoot(end: float) -> np.ndarray:
        return np.asarray(solve_ivp(rate, (0.0, length), [end, 0.0, 0.0, 0.0], "DOP853", **TOLERANCE).y[:, -1])

    end = brentq(lambda at: shoot(at)[0] - angle, *tip, xtol=1e-14, rtol=1e-14)
    at = np.clip(length - np.asarray(s, float), 0.0, length)
    order = np.argsort(at)
    solution = solve_ivp(rate, (0.0, length), [end, 0.0, 0.0, 0.0], "DOP853", t_eval=at[order], **TOLERANCE)
    xy = np.empty((len(at), 2))
    xy[order] = solution.y[2:].T
    return np.c_[xy - shoot(end)[2:], np.zeros(len(at))]


def clamped(links: int, length: float) -> np.ndarray:
    """Where the particles of a rod are along it [m], shape [links + 1], whose first link is clamped: its middle is 0,
    since a chord is parallel to the curve in its middle; the rod's length counts from there."""
    a = length / (links - 0.5)
    return a * (np.arange(links + 1) - 0.5)


def on_clamp(s: np.ndarray, shape: np.ndarray, angle: float = 0.0) -> np.ndarray:
    """The shape with its first two particles on the tangent of the clamp."""
    shape = shape.copy()
    shape[:2] = s[:2, None] * np.array([np.cos(angle), np.sin(angle), 0.0])
    return shape


def frequencies(count: int, length: float, bending: float, per_length: float) -> np.ndarray:
    """Angular frequencies of a clamped and free rod [1/s]: b^2 sqrt(B / (rho A L^4)) with cos b cosh b = -1.

    per_length: rho A [kg/m]."""
    roots = [
        brentq(lambda b: np.cos(b) + 1.0 / np.cosh(b), (k + 0.5) * np.pi - 1.0, (k + 0.5) * np.pi + 1.0)
        for k in range(count)
    ]
    return np.square(roots) * np.sqrt(bending / (per_length * length**4))


def mode(s: np.ndarray, number: int, length: float) -> np.ndarray:
    """Shape of such a vibration, from 0, to any factor."""
    b = np.sqrt(frequencies(number + 1, 1.0, 1.0, 1.0)[number])
    z = b * s / length
    ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    return np.asarray(np.cosh(z) - np.cos(z) - ratio * (np.sinh(z) - np.sin(z)))
