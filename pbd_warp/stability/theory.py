"""Where theory puts the boundaries of the atlas. Shares nothing with the kernels.

Linear algebra of one sweep. With J the gradients of the constraints, W the inverse masses, A = J W J^T, D the
denominators of the multipliers and r the relaxation, a Jacobi sweep takes the errors C to (1 - r A D^-1) C. It
contracts if and only if r lambda_max(D^-1 A) < 2.

    chain of N links, plain sum     A has 2 on its diagonal and -1 beside it, D = 2: lambda_k = 1 - cos(k pi/(N + 1))
    the same, averaged (valence)    the normalised Laplacian of a path, halved: lambda_max = 1
    mass splitting, any graph       D_k = sum over j of |A|_kj at most |J| W |J|^T's row sums, so lambda_max <= 1
    star of d spokes, plain sum     D = 2, A = 1 + n n^T with trace d shared by the directions there are: 2, 3 or 1
    a bar given c times             A = 2 everywhere, D = 2: lambda_max = c
    a triangle given c times        A = 3/2 + 1/2 everywhere for c = 1, lambda_max = 3/2; c times that

In a run, velocities carry what a step leaves: with g = (1 - r lambda)^K after K sweeps, the error goes
e_n+1 = g (2 e_n - e_n-1). That is stable for -1/3 < g < 1: for an even K nothing changes, for an odd one
r lambda < 1 + 3^(-1/K).
"""

from __future__ import annotations

import numpy as np

from pbd_warp.stability.classify import GAINED
from pbd_warp.step.divergence import STRETCHED

GRAVITY = 9.81  # m/s^2
DIRECTIONS = {"planar": 2, "space": 3, "line": 1}
"""What the spokes of a star share their trace among."""

MOST = 2**12
"""Sweeps a frame beyond which nobody looks for a boundary."""


CAPSTAN_BALL, CAPSTAN_SIDE = 0.3, 0.6
"""Radius of the ball, and length of what hangs down on either side [m]."""


def chain_limit(links: float) -> float:
    """Relaxation up to which the plain sum converges on a free straight chain of equal masses."""
    return 2.0 / (1.0 + np.cos(np.pi / (links + 1.0)))


def star_limit(spokes: float, shape: str) -> float:
    """The same for a star of equal masses whose spokes point evenly into all directions of its shape."""
    return 4.0 / (1.0 + spokes / DIRECTIONS[shape])


def bar_limit(copies: float) -> float:
    """The same for a bar given so many times."""
    return 2.0 / copies


def triangle_limit(copies: float) -> float:
    """The same for a triangle of equal sides, each given so many times."""
    return 4.0 / (3.0 * copies)


def sweeps_limit(sweeps: float) -> float:
    """Relaxation times lambda_max up to which a run stays stable with so many sweeps a step."""
    return 2.0 if round(sweeps) % 2 == 0 else 1.0 + 3.0 ** (-1.0 / round(sweeps))


def sag(
    inverse_mass: np.ndarray, sweeps: int, step: float, method: str, load: float = 1.0, length: float = 1.0
) -> float:
    """Largest stretch, over a link's length, of a chain that hangs straight down from a pin when a step makes too few
    sweeps for it.

    Every step the fall of all free particles, step^2 load g, lengthens the link at the pin; K sweeps M leave of all
    errors C* = M^K (C* + step^2 load g e_1). Distances along a line are linear, so this is exact.

    Args:
        inverse_mass: From the pin (0) down, shape [links + 1].
        step: [s]. load: weight over its weight at rest. length: of the chain [m].
        method: "jacobi" (mass splitting) or "gauss-seidel" (two colours, the link at the pin in the first).
    """
    links = len(inverse_mass) - 1
    w = inverse_mass
    a = np.diag(w[:-1] + w[1:]) - np.diag(w[1:-1], 1) - np.diag(w[1:-1], -1)
    if method == "jacobi":
        shared = w * np.r_[1.0, np.full(links - 1, 2.0), 1.0]
        sweep = np.eye(links) - a / (shared[:-1] + shared[1:])
    else:
        odd = np.arange(links) % 2
        first, second = (np.eye(links) - a * ((odd == colour) / np.diag(a)) for colour in (0, 1))
        sweep = second @ first
    left = np.linalg.matrix_power(sweep, sweeps)
    falls = np.zeros(links)
    falls[0] = step**2 * load * GRAVITY
    with np.errstate(all="ignore"):
        error = np.linalg.solve(np.eye(links) - left, left @ falls)
    return float(np.max(error) / (length / links))


def sweeps_for(inverse_mass: np.ndarray, frame: float, method: str, load: float = 1.0, steps: bool = False) -> float:
    """Sweeps a frame that keep the stretch of `sag` at the atlas's limit: iterations of a step, or steps of one."""

    def stretch(sweeps: int) -> float:
        if steps:
            return sag(inverse_mass, 1, frame / sweeps, method, load)
        return sag(inverse_mass, sweeps, frame, method, load)

    low, high = 1, 1
    while stretch(high) > STRETCHED:
        low, high = high, 2 * high
        if high > MOST:
            return float(high)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if stretch(middle) > STRETCHED else (low, middle)
    if high == 1:
        return 1.0
    above, below = stretch(low), stretch(high)
    return low + np.log(above / STRETCHED) / np.log(above / below)


def rope_masses(links: float) -> np.ndarray:
    """Inverse masses of a rope whose first particle is fixed, up to a factor, shape [links + 1]; the last particle has
    half of one link, the others half of two."""
    return np.r_[0.0, np.ones(round(links) - 1), 2.0]


def heavy_bob(ratio: float, links: int) -> np.ndarray:
    """The same with a last particle `ratio` times as heavy as the others."""
    return np.r_[0.0, np.ones(links - 1), 1.0 / ratio]


def textbook_rate(distance: float, error: float, seconds: float = 1.0) -> float:
    """Steps a second at which v = (p - x)/h in float32 goes wrong by `error` [m] over some seconds.

    Every step rounds p by ulp/sqrt(12) in the mean, and v by 1/h of that; n steps add up to a random walk of v, which
    acts for the time: error = seconds ulp/sqrt(12)/h sqrt(n), with n = seconds/h.
    """
    ulp = float(np.spacing(np.float32(distance)))
    return (error * np.sqrt(12.0) / (seconds**1.5 * ulp)) ** (2.0 / 3.0)


def displacement_rate(distance: float, error: float, seconds: float = 1.0) -> float:
    """The same for x += u: only x is rounded, by ulp/sqrt(12) a step: error = ulp/sqrt(12) sqrt(n)."""
    ulp = float(np.spacing(np.float32(distance)))
    return (error * np.sqrt(12.0) / ulp) ** 2 / seconds


def sampled_speed(rate: float, diameter: float) -> float:
    """Speed [m/s] above which overlap at the ends of steps misses: more than both diameters, 2 (r1 + r2), a step."""
    return 2.0 * diameter * rate


def swept_speed(rate: float, diameter: float, epsilon: float) -> float:
    """Speed above which the swept test loses contacts to rounding.

    Its discriminant b^2 - a c is |move|^2 (r1 + r2)^2 for a hit in the middle, a difference of two numbers of
    |move|^2 |start|^2: nothing is left of it when epsilon |start|^2 > (r1 + r2)^2, and |start| is up to a step's way.
    """
    return diameter / np.sqrt(epsilon) * rate


def overlap_rate(depth: float, radius: float) -> float:
    """Steps a second above which three discs, each `depth` of its diameter inside both others, gain too much energy.

    Each is pushed outwards by 2 r depth/sqrt(3) in a step h, so with v = that/h. Line 16 stops each pair, sqrt(3) v,
    with masses split over two contacts each: a quarter of v is left. 3/2 m (v/4)^2 against GAINED of 3 m g size.
    """
    side = 2.0 * radius * (1.0 - depth)
    size = float(np.linalg.norm([side + 2.0 * radius, np.sqrt(0.75) * side + 2.0 * radius, 2.0 * radius]))
    fastest = 4.0 * np.sqrt(2.0 * GAINED * GRAVITY * size)
    return fastest / (2.0 * radius * depth / np.sqrt(3.0))


def capstan(links: int, friction: float) -> float:
    """The ratio of loads at which a rope over half a circle slides, over e^(mu pi): of a polygon with the links of the
    scene "capstan", of which n turn by pi/n each: ((1 + mu tan(pi/2n)) / (1 - mu tan(pi/2n)))^n e^(-mu pi)."""
    n = links * np.pi * CAPSTAN_BALL / (np.pi * CAPSTAN_BALL + 2.0 * CAPSTAN_SIDE)
    grip = friction * np.tan(np.pi / (2.0 * n))
    return float(((1.0 + grip) / (1.0 - grip)) ** n * np.exp(-friction * np.pi))
