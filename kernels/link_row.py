"""The row of a distance in Newton's matrix (newton.py): its block, the force it makes, what the step did to both.

The gradient g is that of C at the end of the step ("pbd", "bdf2"), g = d / |d|, or a discrete one between start and end
("midpoint"), g = (d_0 + d_1) / (|d_0| + |d_1|), for which work is exactly the change of potential energy. Both give
K = kappa (1 - g n^T) with n = d_1 / |d_1| and kappa = -lam / |d_1| or -lam / (|d_0| + |d_1|); with dlam eliminated a
link's block is K + g n^T / (a + e), on the diagonal of both ends and, negative, where they meet.
"""

from __future__ import annotations

import warp as wp

TURN_OFF = wp.constant(0.5)
"""A link much shorter than the others that is too long by this part of its length has lost its direction: for one
iteration it is a point, d = 0 in three rows, which leaves it along the force that it carries."""

SHORT = wp.constant(0.01)
"""Of the mean length of a piece: what counts as much shorter."""

BALANCE = wp.constant(0.2)
"""Of what a length may be off by: what the balance may be, as a displacement. It adds up from step to step: with 1 a
pendulum at 960 steps a second loses 8e-12 of its amplitude in a period, with this 3e-13, for 5 % more iterations."""


@wp.func
def link_row(
    d: wp.vec3d,  # between the ends now [m]
    before: wp.vec3d,  # at the start of the step, where the gradient is a mean
    L: wp.float64,
    a: wp.float64,  # compliance over the force scale
    before_length: wp.float64,
    lam: wp.float64,
    firm: wp.float64,  # 1 / (a + e) of a rigid link
    elastic: wp.float64,  # 0: rigid
    softest: wp.float64,
    short: wp.float64,  # [m]
    mean_gradient: wp.bool,
):
    """M and the force, n, and what `link_step` needs: c, 1 / (a + e), 1 / |d|, what kappa was cut by (-1: a point)."""
    one = wp.float64(1.0)
    zero = wp.float64(0.0)
    half = wp.float64(0.5)
    tiny = wp.float64(1.0e-300)
    identity = wp.identity(3, dtype=wp.float64)
    length = wp.length(d)
    c = length - L
    n = wp.vec3d(one, zero, zero)
    turning = one / wp.max(length, tiny)
    if length > zero:
        n = d * turning
    g = n
    if length < half * L:
        turning = one / (half * L)
    kappa = -lam * turning
    if mean_gradient:
        both = one / wp.max(length + before_length, tiny)
        g = (before + d) * both
        kappa = -lam * both
        if a > zero:
            c = c + (before_length - L)
            a = a + a
    cut = zero
    if kappa < softest:
        cut = softest - kappa
        kappa = softest
    e = firm
    if elastic > zero:
        a = a + elastic
        e = one / a
    c = c + a * lam
    if L < short and length - L > wp.float64(TURN_OFF) * L:
        return e * identity, -e * d, n, wp.vec4d(c, e, turning, -one)
    return kappa * identity + (e - kappa) * wp.outer(g, n), (lam - c * e) * g, n, wp.vec4d(c, e, turning, cut)


@wp.func
def link_step(
    apart: wp.vec3d,  # du of one end less that of the other [m]
    n: wp.vec3d,
    row: wp.vec4d,
    fixed: wp.vec4d,  # rest length, a, |d_0|, w_i + w_j
    lam: wp.float64,
    proximal: wp.float64,  # e
    tolerance: wp.float64,
    relative: wp.float64,
):
    """lam after the step, what is left of length and balance over what is tolerated, how far the ends moved apart.

    Newton's step leaves what is of second order in it; besides, what the proximal compliance did not take, what a cut
    kappa did not see, and rounding."""
    L = fixed[0]
    dlam = -(row[0] + wp.dot(n, apart)) * row[1]
    far = wp.length(apart)
    turn = far * row[2]
    pulled = wp.abs(dlam)
    pull = wp.abs(lam)
    weight = fixed[3]
    long = wp.float64(0.5) * far * turn + proximal * pulled
    rounding = wp.float64(1.0e-16) * row[1]
    off = weight * (turn * (pulled + turn * pull) + (row[3] + rounding) * far)
    of_length = wp.max(tolerance + relative * L, wp.float64(1.0e-150))
    of_force = wp.max(
        wp.float64(BALANCE) * of_length + wp.float64(0.01) * relative * (weight * pull), wp.float64(1.0e-150)
    )
    error = wp.max(long * of_force, off * of_length) / (of_length * of_force)
    return lam + dlam, error, far


@wp.func
def point_row(away: wp.vec3d, lam: wp.vec3d, a: wp.float64, give: wp.float64):
    """Of three rows away + a lam = 0, which are linear: 1 / what they give, and their force."""
    e = wp.float64(1.0) / wp.max(a, give)
    return e, lam - e * (away + a * lam)
