"""Known answers that only tests need; those that scenes are charted against are in pbd_warp/accuracy/references.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigvalsh_tridiagonal
from scipy.special import ellipkm1

from pbd_warp.accuracy.references import solve_hanging


def pendulum_period(theta0: float, length: float, g: float = 9.81) -> float:
    """Period [s] of a pendulum released at rest at the angle theta0.

    T = 4 sqrt(L/g) K(k), k = sin(theta0/2), K the complete elliptic integral of the first kind: a quarter of
    the period is the integral from 0 to theta0 of dtheta/theta', theta'^2 = (2 g/L) (cos(theta) - cos(theta0)),
    which sin(theta/2) = k sin(phi) turns into sqrt(L/g) times that of dphi / sqrt(1 - k^2 sin^2(phi)).

    Args:
        theta0: Angle from the vertical [rad], |theta0| < pi.
        length: [m].
        g: [m/s^2].
    """
    # ellipkm1 takes 1 - k^2 = cos^2(theta0/2), which keeps its digits near pi.
    return float(4.0 * np.sqrt(length / g) * ellipkm1(np.cos(theta0 / 2) ** 2))


def elastic_catenary(
    links: int, link_length: float, span: float, particle_mass: float, compliance: float, g: float = 9.81
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and tensions at rest of a chain of springs between (0, 0, 0) and (span, 0, 0), hanging towards -y.

    As in catenary, tan(theta_i) = V_i/H, but link i has the length a + compliance T_i, T_i^2 = V_i^2 + H^2.

    Args:
        links: Number of links.
        link_length: a, of a link without tension [m].
        span: [m]; may exceed links * link_length.
        particle_mass: Of each particle between the ends [kg].
        compliance: > 0 [m/N].
        g: [m/s^2].

    Returns:
        Positions [m], shape [links + 1, 3], and tensions [N], shape [links].

    Fails when: links < 2, span <= 0, compliance <= 0, or the number of links is odd and span <= link_length (see
    catenary; ValueError each).
    """
    if not (links > 1 and span > 0 and compliance > 0):
        raise ValueError("an elastic catenary needs two links or more, span > 0 and compliance > 0")
    return solve_hanging(np.full(links - 1, particle_mass * g), link_length, span, compliance)


def chain_frequencies(links: int, link_length: float, g: float = 9.81) -> np.ndarray:
    """Angular frequencies of the small sideways oscillations of a hanging chain of equal masses, one end fixed.

    omega_k^2 = (g/a) xi_k, xi_k the roots of the Laguerre polynomial L_N. With u_j the displacement of particle j
    counted from the free end (0), the link above it carries (j + 1) m g:

        -omega^2 u_j = (g/a) ((j + 1) (u_{j+1} - u_j) - j (u_j - u_{j-1}))

    With xi = omega^2 a/g this is the recursion (j + 1) L_{j+1} = (2j + 1 - xi) L_j - j L_{j-1}, so u_j = L_j(xi),
    and the fixed end demands u_N = L_N(xi) = 0. The roots are the eigenvalues of the recursion's tridiagonal matrix
    (Golub and Welsch 1969), to some links^2 machine epsilons; scipy's roots_laguerre is not a number from 400 on.

    Args:
        links: N.
        link_length: a [m].
        g: [m/s^2].

    Returns:
        [rad/s], ascending, shape [links].
    """
    j = np.arange(links, dtype=np.float64)
    return np.sqrt(g / link_length * eigvalsh_tridiagonal(2.0 * j + 1.0, j[1:]))


def string_frequencies(links: int, link_length: float, tension: float, mass: float) -> np.ndarray:
    """Angular frequencies of the small sideways oscillations of a taut string of equal masses, both ends fixed.

    omega = 2 sqrt(T/(m a)) sin(k a/2), k = pi j/(links a), j = 1 .. links - 1: u_i = sin(k a i) in
    m u_i'' = (T/a) (u_{i+1} - 2 u_i + u_{i-1}) gives m omega^2 = (T/a) (2 - 2 cos(k a)); u is 0 at both ends.

    Args:
        links: Number of links.
        link_length: a, under the tension [m].
        tension: T [N].
        mass: Of each particle between the ends, m [kg].

    Returns:
        [rad/s], ascending, shape [links - 1].
    """
    j = np.arange(1, links)
    return 2.0 * np.sqrt(tension / (mass * link_length)) * np.sin(0.5 * np.pi * j / links)


def dumbbell_spin(omega0: float, h: float, steps: int) -> np.ndarray:
    """Spin of a free dumbbell (two particles, a rigid link) under "pbd", which loses some in every step.

    theta' = atan(sin(theta) / (2 - cos(theta))), theta = omega h the angle turned in a step: the step predicts
    2 e_n - e_{n-1} for the direction e of the link and projects it to unit length; with e_n along x and e_{n-1}
    theta behind it the prediction is (2 - cos(theta), sin(theta)). theta' = theta - theta^3 + ..., so
    omega tends to omega0 / sqrt(1 + 2 h omega0^2 t).

    Args:
        omega0: Spin of the step before the start [rad/s]. A simulation that starts with the velocities of a spin
            omega turns atan(omega h) in its first step, so that is omega0 h, and element 0 belongs to this step.
        h: Length of a step [s].
        steps: Number of steps.

    Returns:
        Angle turned in each step over h [rad/s], shape [steps + 1], the first omega0.
    """
    theta = np.empty(steps + 1)
    theta[0] = omega0 * h
    for n in range(steps):
        theta[n + 1] = np.arctan(np.sin(theta[n]) / (2.0 - np.cos(theta[n])))
    return theta / h


def implicit_oscillator(
    n: ArrayLike, h: float, x0: float, mass: float, compliance: float, rest_length: float
) -> np.ndarray:
    """Position of the mass of `oscillator` after n implicit Euler (XPBD) steps from rest.

    x_n - rest = (x0 - rest) r^n cos(n theta), r = (1 + omega^2 h^2)^(-1/2), theta = atan(omega h): with y = x - rest
    the step is (1 + omega^2 h^2) y_{n+1} = 2 y_n - y_{n-1}, whose characteristic roots are r exp(+-i theta), so
    y_n = r^n (c1 cos(n theta) + c2 sin(n theta)). At rest means y_{-1} = y_0, that is
    c1 = (c1 cos(theta) - c2 sin(theta)) / r, and because cos(theta) = r this is c2 = 0.

    Args:
        n: Numbers of steps, any shape.
        h: Length of a step [s].
        x0: > 0 [m].
        mass: [kg].
        compliance: [m/N].
        rest_length: [m]; more than half of x0 (see oscillator).

    Returns:
        [m], the shape of n.
    """
    n = np.asarray(n, dtype=np.float64)
    omega_h = h / np.sqrt(compliance * mass)
    r, theta = 1.0 / np.hypot(1.0, omega_h), np.arctan(omega_h)
    return np.asarray(rest_length + (x0 - rest_length) * r**n * np.cos(n * theta))
