"""Bending of three neighbours i, j, k, without twist: the discrete elastic rod's energy and its derivatives.

    E = B/(2 l) |kb|^2,  kb = 2 t_1 x t_2 / (1 + t_1 . t_2),  |kb| = 2 tan(turn / 2)

t_1, t_2 are the directions of e_1 = x_j - x_i and e_2 = x_k - x_j, and l half the sum of both rest lengths: the turn at
j is that of the curve between the middles of both links, so kb / l is its mean curvature there, of second order in the
link length also where the links are unequal (the middles are where a chord is parallel to the curve to that order).
A link that is fixed, at both its ends, thus clamps the curve in its middle.
Source: Bergou, Wardetzky, Robinson, Audoly, Grinspun 2008, Discrete Elastic Rods, section 4.2; derivatives ours.

All of it depends on c = t_1 . t_2 alone, with q = |kb|^2 = 4 (1 - c)/(1 + c). With a rest turn, of which there is the
size rest = |kb_0| but no direction, since there is no frame,

    E = B/(2 l) (1 + r) (S - S_0)^2,  S = sqrt(q + r rest^2),  S_0 = sqrt((1 + r) rest^2)

whose second derivative at rest is that of a straight one; r rounds the tip of the cone (|kb| - rest)^2, where a curve
is straight and does not know which way to bend.

With the discrete gradient in the place of the gradient, work is exactly the change of E, and the torques of e_1 and e_2
cancel (Gonzalez 1996): E as a function of c by its divided difference, c = e_1 . e_2 / (|e_1| |e_2|) by the product
rule with means, |e| as in distance.py. Where start and end are the same it is the gradient.

Not defined where links fold back on each other; from an angle of FOLD on E goes on linearly in c, and is finite.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Mat33, Real, Vec3, func, index, step_pass

FOLD = wp.constant(1.0e-3)
"""1 + c below which links count as folded: within 2.6 degrees."""

SHORT = wp.constant(1.0e-6)
"""Of l: a shorter link counts as so long."""

ROUNDED = wp.constant(0.01)
"""r above: the cone is rounded where the turn is a tenth of that at rest."""


@func
def slope(before: Real, now: Real, rest: Real):
    """Of E l / B between two values of c: the divided difference, and its derivative by the second of them. Where they
    are equal that is the derivative and half of the second derivative."""
    one = Real(1.0)
    fold = Real(FOLD)
    u = wp.max(one + before, fold)
    v = wp.max(one + now, fold)
    over = -Real(4.0) / (u * v)
    if rest == Real(0.0):
        if one + now < fold:
            return over, Real(0.0)
        return over, -over / v
    r = Real(ROUNDED)
    tip = r * rest * rest
    S_rest = wp.sqrt(one + r) * rest
    S = wp.sqrt(wp.max(Real(8.0) / u - Real(4.0), Real(0.0)) + tip)
    T = wp.sqrt(wp.max(Real(8.0) / v - Real(4.0), Real(0.0)) + tip)
    over = (one + r) * over
    part = Real(2.0) * S_rest / (S + T)
    value = over * (one - part)
    if one + now < fold:
        return value, Real(0.0)
    return value, -value / v - over * part / (S + T) * Real(4.0) / (v * v * T)


@func
def discrete_gradient(f1: Vec3, f2: Vec3, e1: Vec3, e2: Vec3, length: Real, rest: Real):
    """dE / de_1 and dE / de_2, over B / l, between f (before) and e (now)."""
    one = Real(1.0)
    half = Real(0.5)
    short = Real(SHORT) * length
    a = one / wp.max(wp.length(f1), short)
    b = one / wp.max(wp.length(f2), short)
    p = one / wp.max(wp.length(e1), short)
    q = one / wp.max(wp.length(e2), short)
    before = wp.dot(f1, f2)
    now = wp.dot(e1, e2)
    D, rise = slope(before * a * b, now * p * q, rest)
    scale = half * D * (a * b + p * q)
    mean = half * D * (before + now)
    k1 = half * mean * (b + q) * a * p / (one / a + one / p)
    k2 = half * mean * (a + p) * b * q / (one / b + one / q)
    scale = half * scale
    return scale * (f2 + e2) - k1 * (f1 + e1), scale * (f1 + e1) - k2 * (f2 + e2)


@func
def cross_matrix(a: Vec3):
    """[a]: [a] b = a x b."""
    zero = Real(0.0)
    return Mat33(zero, -a[2], a[1], a[2], zero, -a[0], -a[1], a[0], zero)


@func
def turning(e1: Vec3, e2: Vec3, length: Real, rest: Real):
    """dkb / de_1, dkb / de_2, and of E l / B by kb the derivative, and the part of the second that is not negative."""
    one = Real(1.0)
    zero = Real(0.0)
    p = one / wp.max(wp.length(e1), Real(SHORT) * length)
    q = one / wp.max(wp.length(e2), Real(SHORT) * length)
    t1 = p * e1
    t2 = q * e2
    c = wp.dot(t1, t2)
    u = wp.max(one + c, Real(FOLD))
    across = wp.cross(t1, t2)
    kb = Real(2.0) / u * across
    J1 = (-p / u) * (Real(2.0) * (cross_matrix(t2) + wp.outer(across, t1)) + wp.outer(kb, t2 - c * t1))
    J2 = (q / u) * (Real(2.0) * (cross_matrix(t1) - wp.outer(across, t2)) - wp.outer(kb, t1 - c * t2))
    H = wp.identity(3, dtype=Real)
    moment = kb
    if rest > zero:
        r = Real(ROUNDED)
        square = wp.dot(kb, kb)
        tip = r * rest * rest
        S = wp.sqrt(square + tip)
        part = wp.sqrt(one + r) * rest / S
        around = (one + r) * wp.max(one - part, zero)
        moment = ((one + r) * (one - part)) * kb
        along = (one + r) * wp.max(one - part * tip / (S * S), zero)
        H = around * H
        if square > zero:
            H = H + ((along - around) / square) * wp.outer(kb, kb)
    return J1, J2, moment, H


@step_pass
def project_bending(
    n: wp.int32,
    # Model:
    triple: wp.array[wp.vec3i],  # [bend_count] i, j, k
    compliance: wp.array[Real],  # [bend_count] l / B [1/(N m)]
    length: wp.array[Real],  # [bend_count] l [m]
    rest: wp.array[Real],  # [bend_count] |kb| at rest
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    u: wp.array[Vec3],  # [particle_count] [m]
    valence: wp.array[wp.int32],  # [particle_count] constraints at each particle, or None: masses are not split
    relaxation: Real,
    compliance_scale: wp.array[Real],  # [1] [1/s^2]
    mean_gradient: wp.bool,  # force along the mean of the configurations before and after the step
    # Out:
    lam: wp.array[Vec3],  # [bend_count] minus the moment, over the force scale [kg m^2]
    residual: wp.array[Real],  # [1] largest |C + a lam| l [m], or None: not wanted
    correction: wp.array[Vec3],  # [particle_count] [m], added to
):
    """Line 10 for bending, XPBD with three rows a triple: C = l/B dE/dkb, which is kb where it is straight at rest.

    dlam = -(H J W J^T + a)^-1 (C + a lam), p += W J^T dlam. With the mean gradient C is the sum of those before and
    after, and J that of the mean configuration, which is of second order; what conserves energy is `Direct`."""
    i = index(triple[n][0])
    j = index(triple[n][1])
    k = index(triple[n][2])
    w_i = w[i]
    w_j = w[j]
    w_k = w[k]
    v_i = w_i
    v_j = w_j
    v_k = w_k
    if valence:
        v_i = Real(valence[i]) * w_i
        v_j = Real(valence[j]) * w_j
        v_k = Real(valence[k]) * w_k
    if v_i + v_j + v_k > Real(0.0):
        f1 = x[j] - x[i]
        f2 = x[k] - x[j]
        e1 = f1 + (u[j] - u[i])
        e2 = f2 + (u[k] - u[j])
        a = compliance[n] * compliance_scale[0]
        J1, J2, C, H = turning(e1, e2, length[n], rest[n])
        if mean_gradient:
            I1, I2, before, H0 = turning(f1, f2, length[n], rest[n])
            J1, J2, middle, H1 = turning(Real(0.5) * (f1 + e1), Real(0.5) * (f2 + e2), length[n], rest[n])
            C = C + before
            a = a + a
        C = C + a * lam[n]
        if residual:
            wp.atomic_max(residual, 0, length[n] * wp.length(C))
        J = J1 - J2
        A = v_i * (J1 * wp.transpose(J1)) + v_j * (J * wp.transpose(J)) + v_k * (J2 * wp.transpose(J2))
        M = H * A + a * wp.identity(3, dtype=Real)
        size = wp.trace(M)
        dlam = (-relaxation / size) * (wp.inverse(M / size) * C)
        lam[n] = lam[n] + dlam
        D1 = wp.transpose(J1) * dlam
        D2 = wp.transpose(J2) * dlam
        wp.atomic_sub(correction, i, w_i * D1)
        wp.atomic_add(correction, j, w_j * (D1 - D2))
        wp.atomic_add(correction, k, w_k * D2)
