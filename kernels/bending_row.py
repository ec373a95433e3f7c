"""Bending (bending.py) in Newton's matrix: its rows, and what a step leaves of them.

Of three neighbours with e_1 = x_j - x_i, e_2 = x_k - x_j and forces -D_1, -D_2 along these, the matrix gets the blocks
of the derivatives H_ab = dD_a / de_b, on the diagonals of i, j, k and where they meet: two more than from the links.
They are exact where the whole matrix is positive with them. Where it is not (a rod that buckles, a curl that is pulled
straight and may bend to any side), the step is made with the part that is never negative, J^T H J with J = dkb / de
(Gauss-Newton), and with the links' own limit for pushing.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels import bending
from pbd_warp.kernels.pieces import Bends, Links, Matrix, Particles, Schedule
from pbd_warp.kernels.touch import double

slope = bending.slope[wp.float64]
discrete_gradient = bending.discrete_gradient[wp.float64]
turning = bending.turning[wp.float64]


@wp.func
def exact_derivatives(e1: wp.vec3d, e2: wp.vec3d, length: wp.float64, rest: wp.float64):
    """D_1, D_2 and H_11, H_12, H_22 of E l / B; H_21 is the transpose of H_12."""
    one = wp.float64(1.0)
    short = wp.float64(bending.SHORT) * length
    p = one / wp.max(wp.length(e1), short)
    q = one / wp.max(wp.length(e2), short)
    t1 = p * e1
    t2 = q * e2
    c = wp.dot(t1, t2)
    E1, half = slope(c, c, rest)
    E2 = half + half
    g1 = p * (t2 - c * t1)
    g2 = q * (t1 - c * t2)
    identity = wp.identity(3, dtype=wp.float64)
    T1 = wp.outer(t1, t1)
    T2 = wp.outer(t2, t2)
    G1 = wp.outer((E2 * g1 - (E1 * p) * t1), g1) - wp.outer((E1 * p) * g1, t1) - (E1 * p * p * c) * (identity - T1)
    G2 = wp.outer((E2 * g2 - (E1 * q) * t2), g2) - wp.outer((E1 * q) * g2, t2) - (E1 * q * q * c) * (identity - T2)
    both = wp.outer((E2 * g1 - (E1 * p) * t1), g2) + (E1 * p * q) * (identity - T2)
    return E1 * g1, E1 * g2, G1, both, G2


@wp.func
def mean_derivatives(
    f1: wp.vec3d, f2: wp.vec3d, e1: wp.vec3d, e2: wp.vec3d, length: wp.float64, rest: wp.float64
):  # fmt: skip
    """The discrete D_1, D_2 between f and e, and their derivatives H_11, H_12, H_21, H_22 by e, of E l / B."""
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    short = wp.float64(bending.SHORT) * length
    a = one / wp.max(wp.length(f1), short)
    b = one / wp.max(wp.length(f2), short)
    p = one / wp.max(wp.length(e1), short)
    q = one / wp.max(wp.length(e2), short)
    t1 = p * e1
    t2 = q * e2
    before = wp.dot(f1, f2)
    now = wp.dot(e1, e2)
    c = now * p * q
    D, rise = slope(before * a * b, c, rest)
    gamma = half * (before + now)
    s = half * (a * b + p * q)
    m1 = half * (a + p)
    m2 = half * (b + q)
    r1 = one / (one / a + one / p)
    r2 = one / (one / b + one / q)
    n1 = r1 * (f1 + e1)
    n2 = r2 * (f2 + e2)
    h1 = half * (f1 + e1)
    h2 = half * (f2 + e2)
    k1 = gamma * m2 * a * p
    k2 = gamma * m1 * b * q
    P1 = s * h2 - k1 * n1  # discrete gradient of c
    P2 = s * h1 - k2 * n2
    g1 = p * (t2 - c * t1)  # gradient of c now
    g2 = q * (t1 - c * t2)
    # Derivatives of s, k1, k2 by e1 and e2.
    s1 = (-half * p * p * q) * t1
    s2 = (-half * p * q * q) * t2
    k11 = (half * m2 * a * p) * e2 - (k1 * p) * t1
    k12 = (half * m2 * a * p) * e1 - (half * gamma * a * p * q * q) * t2
    k21 = (half * m1 * b * q) * e2 - (half * gamma * b * q * p * p) * t1
    k22 = (half * m1 * b * q) * e1 - (k2 * q) * t2
    identity = wp.identity(3, dtype=wp.float64)
    H11 = wp.outer(h2, s1) - wp.outer(n1, k11) - (k1 * r1) * (identity - wp.outer(n1, t1))
    H12 = (half * s) * identity + wp.outer(h2, s2) - wp.outer(n1, k12)
    H21 = (half * s) * identity + wp.outer(h1, s1) - wp.outer(n2, k21)
    H22 = wp.outer(h1, s2) - wp.outer(n2, k22) - (k2 * r2) * (identity - wp.outer(n2, t2))
    return (
        D * P1,
        D * P2,
        D * H11 + wp.outer(rise * P1, g1),
        D * H12 + wp.outer(rise * P1, g2),
        D * H21 + wp.outer(rise * P2, g1),
        D * H22 + wp.outer(rise * P2, g2),
    )


@wp.func
def begin_bends(piece: wp.int32, bends: Bends, x: wp.array[Any], u: wp.array[Any], soften: wp.float64):
    """What of a step's bending is known before it; soften: 1 over the integrator's force scale [1/s^2]."""
    bends.scale[piece] = wp.float64(1.0) / soften
    for q in range(bends.first[piece], bends.first[piece + 1]):
        triple = bends.particle[q]
        tile = bends.tile[q]
        i = triple[0]
        j = triple[1]
        k = triple[2]
        e1 = double(x[j]) - double(x[i])
        e2 = double(x[k]) - double(x[j])
        bends.before1[q] = e1
        bends.before2[q] = e2
        if tile[0] < 0:
            e1 = e1 - double(u[i])
        if tile[1] < 0:
            e1 = e1 + double(u[j])
            e2 = e2 - double(u[j])
        if tile[2] < 0:
            e2 = e2 + double(u[k])
        bends.start1[q] = e1
        bends.start2[q] = e2


@wp.func
def stiffen(piece: wp.int32, p: Particles, bends: Bends):
    """How firmly bending holds particles that touch something (`find_stiffness` of progress.py)."""
    for q in range(bends.first[piece], bends.first[piece + 1]):
        shape = bends.shape[q]
        across = bends.scale[piece] * shape[0] / (shape[1] * shape[1])
        for a in range(3):
            t = bends.tile[q][a]
            if t >= 0:
                p.stiffness[t] = p.stiffness[t] + across


@wp.func
def limit_pushes(begin: wp.int32, end: wp.int32, links: Links, bends: Bends, exact: wp.bool):
    """How negative the stiffness of links that push may be: a rod can push, so at first there is no limit."""
    for q in range(begin, end):
        links.softest[q] = bends.softest[q]
        if exact:
            links.softest[q] = wp.float64(-1.0e300)


@wp.func
def add_pair(a: wp.int32, b: wp.int32, slot: wp.int32, K_ab: wp.mat33d, K_ba: wp.mat33d, m: Matrix):
    """Where tiles a and b meet: below the diagonal stands the row of the later one."""
    if slot >= 0:
        if a < b:
            m.low[slot] = m.low[slot] + K_ba
            m.up[slot] = m.up[slot] + K_ab
        else:
            m.low[slot] = m.low[slot] + K_ab
            m.up[slot] = m.up[slot] + K_ba


@wp.func
def bending_pass(
    begin: wp.int32,
    end: wp.int32,
    piece: wp.int32,
    s: Schedule,
    m: Matrix,
    p: Particles,
    bends: Bends,
    mean_gradient: wp.bool,
):
    """The rows of all triples of a piece, before those of the links. No slot of theirs is a link's first: all of them
    are zeroed here."""
    scale = bends.scale[piece]
    exact = bends.exact[piece] == 1
    for k in range(s.column_first[begin], s.column_first[end]):
        m.low[k] = wp.mat33d()
        m.up[k] = wp.mat33d()
    for q in range(bends.first[piece], bends.first[piece + 1]):
        tile = bends.tile[q]
        i = tile[0]
        j = tile[1]
        k = tile[2]
        e1 = bends.start1[q]
        e2 = bends.start2[q]
        if i >= 0:
            e1 = e1 - p.move[i]
        if j >= 0:
            e1 = e1 + p.move[j]
            e2 = e2 - p.move[j]
        if k >= 0:
            e2 = e2 + p.move[k]
        shape = bends.shape[q]
        stiff = scale * shape[0]
        H12 = wp.mat33d()
        if mean_gradient:
            D1, D2, H11, H12, H21, H22 = mean_derivatives(
                bends.before1[q], bends.before2[q], e1, e2, shape[1], shape[2]
            )
        else:
            D1, D2, H11, H12, H22 = exact_derivatives(e1, e2, shape[1], shape[2])
            H21 = wp.transpose(H12)
        if not exact:
            J1, J2, moment, H = turning(e1, e2, shape[1], shape[2])
            if mean_gradient:
                H = wp.float64(0.5) * H
            H11 = wp.transpose(J1) * H * J1
            H12 = wp.transpose(J1) * H * J2
            H21 = wp.transpose(H12)
            H22 = wp.transpose(J2) * H * J2
        H11 = stiff * H11
        H12 = stiff * H12
        H21 = stiff * H21
        H22 = stiff * H22
        if i >= 0:
            m.D[i] = m.D[i] + H11
            m.b[i] = m.b[i] + stiff * D1
        if j >= 0:
            m.D[j] = m.D[j] + (H11 - H12 - H21 + H22)
            m.b[j] = m.b[j] + stiff * (D2 - D1)
        if k >= 0:
            m.D[k] = m.D[k] + H22
            m.b[k] = m.b[k] - stiff * D2
        slot = bends.slot[q]
        add_pair(i, j, slot[0], H12 - H11, H21 - H11, m)
        add_pair(j, k, slot[1], H12 - H22, H21 - H22, m)
        add_pair(i, k, slot[2], -H12, -H21, m)


@wp.func
def positive(begin: wp.int32, end: wp.int32, m: Matrix, p: Particles):
    """Whether all pivots are: then a symmetric matrix is."""
    zero = wp.float64(0.0)
    for t in range(begin, end):
        F = m.F[t]
        if p.weight[t] > zero and not (F[0, 0] > zero and F[1, 1] > zero and F[2, 2] > zero):
            return False
    return True


@wp.func
def bending_steps(
    piece: wp.int32,
    m: Matrix,
    p: Particles,
    bends: Bends,
    tolerance: wp.float64,
    relative: wp.float64,
):
    """What a step leaves of the balance, over what is tolerated: an angle, of second order in how links turned; of
    bending that is too soft for it, the displacement that this force makes, over the length."""
    scale = bends.scale[piece]
    exact = bends.exact[piece] == 1
    error = wp.float64(0.0)
    one = wp.float64(1.0)
    for q in range(bends.first[piece], bends.first[piece + 1]):
        tile = bends.tile[q]
        i = tile[0]
        j = tile[1]
        k = tile[2]
        e1 = bends.start1[q]
        e2 = bends.start2[q]
        d1 = wp.vec3d()
        d2 = wp.vec3d()
        weight = wp.float64(0.0)
        if i >= 0:
            e1 = e1 - p.move[i]
            d1 = d1 - m.b[i]
            weight = weight + p.weight[i]
        if j >= 0:
            e1 = e1 + p.move[j]
            e2 = e2 - p.move[j]
            d1 = d1 + m.b[j]
            d2 = d2 - m.b[j]
            weight = weight + p.weight[j]
        if k >= 0:
            e2 = e2 + p.move[k]
            d2 = d2 + m.b[k]
            weight = weight + p.weight[k]
        shape = bends.shape[q]
        short = wp.float64(bending.SHORT) * shape[1]
        a = one / wp.max(wp.length(e1), short)
        b = one / wp.max(wp.length(e2), short)
        t1 = a * e1
        t2 = b * e2
        r1 = a * d1
        r2 = b * d2
        turn = wp.length(r1) + wp.length(r2)
        u = wp.max(one + wp.dot(t1, t2), wp.float64(bending.FOLD))
        bent = (wp.length(t2 - t1) + shape[2]) / u
        left = turn * (wp.length(r2 - r1) / u + turn * bent)
        if not exact:
            left = left + turn * bent
        responds = weight * scale * shape[0] * a * b
        # What is this much stiffer than inertia hides it behind its rounding, and what moves as a whole with it.
        left = left + turn * wp.min(wp.float64(1.0e-16) * responds, one)
        error = wp.max(error, left * wp.min(one, responds) / (relative + tolerance / shape[1]))
    return error
