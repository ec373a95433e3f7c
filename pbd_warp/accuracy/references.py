"""Known answers in float64, against which simulations are judged. NumPy and SciPy only: nothing here calls a kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.linalg import solve_banded
from scipy.optimize import brentq
from scipy.special import ellipj

from pbd_warp.accuracy.rods import clamped, elastica, frequencies, mode, on_clamp

__all__ = ["clamped", "elastica", "frequencies", "mode", "on_clamp"]

# Root-finding to the last bits: brentq's smallest relative tolerance, and an absolute one that never decides.
ROOT = {"xtol": 1e-300, "rtol": 4 * np.finfo(float).eps, "maxiter": 1000}


# Motion of a chain of rigid links.


def chain(
    times: ArrayLike,
    x0: ArrayLike,
    v0: ArrayLike,
    w: ArrayLike,
    gravity: ArrayLike,
    rtol: float = 1e-12,
    atol: float = 1e-13,
) -> tuple[np.ndarray, np.ndarray]:
    """Motion of particles joined in a row by rigid links, as the index-reduced differential-algebraic equation.

    With d_k = x_{k+1} - x_k and C_k = (|d_k|^2 - |d_k(0)|^2) / 2, the accelerations are

        a_k = g + w_k (s_k d_k - s_{k-1} d_{k-1})       s_k: tension over length [N/m], -lambda of the DAE

    and C_k'' = d_k . (a_{k+1} - a_k) + |d_k'|^2 = 0 makes s the solution of the tridiagonal (J W J^T) s = b:

        (w_k + w_{k+1}) |d_k|^2 s_k - w_k d_k . d_{k-1} s_{k-1} - w_{k+1} d_k . d_{k+1} s_{k+1}
            = |d_k'|^2 + d_k . (g_{k+1} - g_k)          g_k = g, or 0 for a fixed particle

    Integrated by DOP853. Nothing pulls C back to 0: its drift, some 1e-11 over 1 s, is a measure of the error.

    Args:
        times: Ascending times, from 0 on [s], shape [time_count].
        x0: Positions at time 0 [m], shape [n, 3], n >= 2. Their distances are the lengths of the links.
        v0: Velocities at time 0 [m/s], shape [n, 3]. Those of fixed particles are ignored.
        w: Inverse masses [1/kg], shape [n]; 0 is a fixed particle.
        gravity: [m/s^2], shape [3].
        rtol: Relative tolerance of one step.
        atol: Absolute tolerance of one step [m, m/s].

    Returns:
        Positions [m] and velocities [m/s], each of shape [time_count, n, 3].

    Fails when: v0 stretches a link, or two joined particles, not both fixed, coincide (ValueError each). Beyond
    some seconds a swinging chain is chaotic, and no tolerance makes its positions known.
    """
    times, w = np.asarray(times, dtype=np.float64), np.asarray(w, dtype=np.float64)
    x0, v0 = np.array(x0, dtype=np.float64), np.array(v0, dtype=np.float64)
    n = len(w)
    v0[w == 0] = 0.0
    g = np.where(w[:, None] > 0, np.asarray(gravity, dtype=np.float64), 0.0)
    relative_g = np.diff(g, axis=0)
    link_w = w[:-1] + w[1:]
    # A link between fixed particles has the empty equation 0 s = 0; 1 s = 0 keeps it out of the others' way.
    empty = np.where(link_w == 0, 1.0, 0.0)

    d, d_rate = np.diff(x0, axis=0), np.diff(v0, axis=0)
    if np.any((d == 0).all(axis=1) & (link_w > 0)):
        raise ValueError("two joined particles coincide: their link has no direction")
    stretching = np.abs(np.sum(d * d_rate, axis=1)) > 1e-9 * np.linalg.norm(d, axis=1) * np.linalg.norm(v0)
    if np.any(stretching):
        raise ValueError(f"v0 stretches link {np.flatnonzero(stretching)[0]}, which is rigid")

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        x, v = state.reshape(2, n, 3)
        d, d_rate = x[1:] - x[:-1], v[1:] - v[:-1]
        bands = np.zeros((3, n - 1))
        bands[1] = link_w * np.einsum("ki,ki->k", d, d) + empty
        bands[0, 1:] = bands[2, :-1] = -w[1:-1] * np.einsum("ki,ki->k", d[1:], d[:-1])
        b = np.einsum("ki,ki->k", d_rate, d_rate) + np.einsum("ki,ki->k", d, relative_g)
        pull = solve_banded((1, 1), bands, b, overwrite_ab=True, overwrite_b=True, check_finite=False)[:, None] * d
        force = np.zeros((n, 3))
        force[:-1] = pull
        force[1:] -= pull
        return np.concatenate([v, g + w[:, None] * force]).ravel()

    start = np.concatenate([x0, v0]).ravel()
    if times[-1] == 0.0:  # an interval of no length, which the integrator does not take
        return np.tile(x0, (len(times), 1, 1)), np.tile(v0, (len(times), 1, 1))
    solution = solve_ivp(rate, (0.0, times[-1]), start, "DOP853", t_eval=times, rtol=rtol, atol=atol)
    if not solution.success:
        raise ArithmeticError(f"the reference of the chain could not be integrated: {solution.message}")
    states = solution.y.T.reshape(len(times), 2, n, 3)
    return states[:, 0], states[:, 1]


def pendulum_angle(t: ArrayLike, theta0: float, length: float, g: float = 9.81) -> np.ndarray:
    """Angle from the vertical [rad] at the times t of a pendulum released at rest at theta0.

    tan(theta/2) = tan(theta0/2) cn(sqrt(g/L) t, k), k = sin(theta0/2): energy gives sin(theta/2) = k cd(...)
    (see pendulum_period, phi counted from the release), hence cos^2(theta/2) = 1 - k^2 cd^2 = (1 - k^2)/dn^2;
    the quotient is the formula. Unlike the arcsine of k cd it is well-conditioned at every angle.

    Args:
        t: Times since the release, of any sign [s], any shape.
        theta0: [rad], |theta0| < pi.
        length: [m].
        g: [m/s^2].

    Returns:
        [rad], the shape of t.
    """
    cn = ellipj(np.sqrt(g / length) * np.asarray(t, dtype=np.float64), np.sin(theta0 / 2) ** 2)[1]
    return np.asarray(2.0 * np.arctan(np.tan(theta0 / 2) * cn))


# Chains at rest.


def catenary(links: int, link_length: float, span: float, masses: ArrayLike | None = None) -> np.ndarray:
    """Positions at rest of a chain of rigid links between (0, 0, 0) and (span, 0, 0), hanging towards -y.

    tan(theta_i) = V_i/H: the tension of link i (from particle i to i + 1) has the same horizontal component H
    in every link, and vertical ones with V_i - V_{i-1} = m_i g (balance at particle i). H and V_0 follow from
    sum a cos(theta_i) = span and sum a sin(theta_i) = 0.

    Args:
        links: Number of links.
        link_length: a [m].
        span: [m].
        masses: Of the particles between the ends, to any common factor, shape [links - 1]. Default: equal.

    Returns:
        [m], shape [links + 1, 3].

    Fails when: not links * link_length > span > 0, or the number of links is odd and span <= link_length, where
    the link at the bottom would have to push (ValueError each).
    """
    if not links * link_length > span > 0:
        raise ValueError("a catenary needs links * link_length > span > 0")
    weights = np.ones(links - 1) if masses is None else np.asarray(masses, dtype=np.float64)
    return solve_hanging(weights, link_length, span, 0.0)[0]


def solve_hanging(
    weights: np.ndarray, link_length: float, span: float, compliance: float
) -> tuple[np.ndarray, np.ndarray]:
    """Both catenaries: positions [links + 1, 3] and tensions [links] of weights [links - 1] between fixed ends.

    The ends are joined where sum l_i sin(theta_i) = 0 and sum l_i cos(theta_i) = span, the derivatives in V_0 and H
    of the convex sum of a T_i + compliance T_i^2 / 2. So the first grows with V_0, from which it has its root,
    and at that root the second grows with H: two nested root-findings, neither with a second root.
    """
    links = len(weights) + 1
    if links % 2 and span <= link_length:
        raise ValueError("the span is too small: with an odd number of links it must exceed one link's length")
    total = weights.sum()
    below = np.concatenate([[0.0], np.cumsum(weights)])  # V_i - V_0

    def links_at(horizontal: float, v0: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        vertical = v0 + below
        tension = np.hypot(horizontal, vertical)
        scale = link_length / tension + compliance
        return scale * horizontal, scale * vertical, tension

    def level(horizontal: float) -> float:
        """V_0 at which both ends are equally high: at -(total weight) no link rises, at 0 none falls."""
        return brentq(lambda v0: links_at(horizontal, v0)[1].sum(), -total, 0.0, **ROOT)

    def excess(horizontal: float) -> float:
        return links_at(horizontal, level(horizontal))[0].sum() - span

    # Two values of H at which the chain is wider than span, because |V_i| <= the total weight and thus
    # cos(theta_i) >= 1 - total^2 / (2 H^2), and because l_i cos(theta_i) >= compliance H. Doubled for round-off.
    slack = 1.0 - span / (links * link_length)
    by_length = 2.0 * total * np.sqrt(0.5 / slack) if slack > 0 else np.inf
    by_stretch = 2.0 * span / (links * compliance) if compliance > 0 else np.inf
    enough = min(by_length, by_stretch)
    horizontal = brentq(excess, 1e-12 * min(enough, total), enough, **ROOT)
    dx, dy, tension = links_at(horizontal, level(horizontal))
    steps = np.stack([dx, dy, np.zeros_like(dx)], axis=1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]), tension


def hanging_chain(
    masses: ArrayLike, link_length: float, compliance: float = 0.0, g: float = 9.81
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and tensions at rest of a chain hanging straight down (-y) from a particle fixed at the origin.

    T_i = g sum_{j >= i} m_j: link i carries all that hangs below it. Its length is link_length + compliance T_i.

    Args:
        masses: From the top down, without the fixed one [kg], shape [n].
        link_length: Of a link without tension [m].
        compliance: [m/N].
        g: [m/s^2].

    Returns:
        Positions [m], shape [n + 1, 3], and tensions [N], shape [n].
    """
    masses = np.asarray(masses, dtype=np.float64)
    tensions = g * np.cumsum(masses[::-1])[::-1]
    positions = np.zeros((len(masses) + 1, 3))
    positions[1:, 1] = -np.cumsum(link_length + compliance * tensions)
    return positions, tensions


# Small oscillations.


# What the schemes themselves do.


def oscillator(t: ArrayLike, x0: float, mass: float, compliance: float, rest_length: float) -> np.ndarray:
    """Position along x of a mass on a spring, whose other end is fixed at the origin; released at rest at x0.

    x = rest + (x0 - rest) cos(omega t), omega = 1/sqrt(compliance mass), from mass x'' = -(x - rest)/compliance.

    Args:
        t: Times since the release [s], any shape.
        x0: > 0 [m].
        mass: [kg].
        compliance: [m/N].
        rest_length: [m]; more than half of x0, so that the mass never reaches the origin.

    Returns:
        [m], the shape of t.
    """
    omega = 1.0 / np.sqrt(compliance * mass)
    return np.asarray(rest_length + (x0 - rest_length) * np.cos(omega * np.asarray(t, dtype=np.float64)))
