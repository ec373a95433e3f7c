"""Multipliers of the rigid links of a path, from one elimination; and what positions and velocities need of it.

With d_k = x_{k+1} - x_k and C_k = (|d_k|^2 - L_k^2) / 2, a particle's acceleration is

    a_k = g + w_k (lam_{k-1} d_{k-1} - lam_k d_k)

and C_k'' = d_k . (a_{k+1} - a_k) + |d_k'|^2 = 0 makes lam [N/m] the solution of a tridiagonal system, A = J W J^T:

    (w_k + w_{k+1}) |d_k|^2 lam_k - w_k d_{k-1}.d_k lam_{k-1} - w_{k+1} d_k.d_{k+1} lam_{k+1}
        = -|d_k'|^2 - d_k . (g_{k+1} - g_k)          g_k = g, or 0 for a particle that is held

With -C_k or -d_k . d_k' on the right its solution puts positions back onto the lengths, or velocities onto their
tangent, by the change that is least in the metric of the masses. The elimination goes along the path, with `inverse`
for 1 / pivot:

    lower_k = A_{k-1,k} inverse_{k-1},   inverse_k = 1 / (A_kk - A_{k-1,k} lower_k),
    y_k = (rhs_k - A_{k-1,k} y_{k-1}) inverse_k,   and back   lam_k = y_k - lower_{k+1} lam_{k+1}

A link whose lam is known, that of a spring, is a row with inverse 0 and y = lam; one that the others already determine
(a straight rope held at both ends has one too many) is one with inverse 0 and y = 0.
Source: C'' = 0 of Baumgarte 1972; the elimination is Thomas's; ours.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import BLOCK, Real, Vec3, func


@wp.func
def in_block(s: wp.int32, stage: wp.int32, stage_count: wp.int32):
    """Where the acceleration of a place in a stage is: by blocks of places, in them by stages."""
    return ((s / BLOCK) * stage_count + stage) * BLOCK + s % BLOCK


@func
def accelerate_path(
    begin: wp.int32,
    end: wp.int32,
    gravity: Vec3,
    rest_length: wp.array[Real],
    compliance: wp.array[Real],
    x: wp.array[Vec3],
    w: wp.array[Real],
    u: wp.array[Vec3],
    v: wp.array[Vec3],
    stage: wp.int32,
    stage_count: wp.int32,
    vanishing: Real,
    direction: wp.array[Vec3],
    lower: wp.array[Real],
    y: wp.array[Real],
    k: wp.array[Vec3],
):
    """Accelerations of a stage, at the positions x + u with the velocities v."""
    zero = Real(0.0)
    u_i = u[begin]
    v_i = v[begin]
    w_i = w[begin]
    d_before = Vec3()
    inverse = zero
    known = zero
    for s in range(begin, end - 1):
        u_j = u[s + 1]
        v_j = v[s + 1]
        w_j = w[s + 1]
        d = (x[s + 1] - x[s]) + (u_j - u_i)
        rate = v_j - v_i
        size = wp.dot(d, d)
        off = -w_i * wp.dot(d_before, d)
        square = off * off
        rhs = -wp.dot(rate, rate) - off * known
        if w_i == zero and w_j > zero:
            rhs = rhs - wp.dot(d, gravity)
        if w_j == zero and w_i > zero:
            rhs = rhs + wp.dot(d, gravity)
        diagonal = (w_i + w_j) * size
        lower[s] = off * inverse
        pivot = diagonal - square * inverse  # not off * coupling, which would be one multiplication later
        inverse = zero
        known = zero
        if pivot > vanishing * diagonal:
            inverse = Real(1.0) / pivot
            known = rhs * inverse
        if compliance:
            if compliance[s] > zero:
                inverse = zero
                known = (rest_length[s] / wp.sqrt(size) - Real(1.0)) / compliance[s]
        direction[s] = d
        y[s] = known
        d_before = d
        u_i = u_j
        v_i = v_j
        w_i = w_j

    coupling = zero
    lam = zero
    ahead = Vec3()
    for r in range(end - 1 - begin):
        s = end - 2 - r
        lam = y[s] - coupling * lam
        coupling = lower[s]
        pull = lam * direction[s]
        a = Vec3()
        if w_i > zero:
            a = gravity + w_i * (pull - ahead)
        k[in_block(s + 1, stage, stage_count)] = a
        w_i = w[s]
        ahead = pull
    a = Vec3()
    if w_i > zero:
        a = gravity - w_i * ahead
    k[in_block(begin, stage, stage_count)] = a


@func
def correct_path(
    begin: wp.int32,
    end: wp.int32,
    of_velocities: wp.bool,
    rest_length: wp.array[Real],
    compliance: wp.array[Real],
    x: wp.array[Vec3],
    w: wp.array[Real],
    vanishing: Real,
    direction: wp.array[Vec3],
    lower: wp.array[Real],
    y: wp.array[Real],
    u: wp.array[Vec3],
    v: wp.array[Vec3],
):
    """One solution that puts the positions x + u back onto the lengths, or the velocities v onto their tangent there.

    Returns what it left of links that the others determine, and the largest square of a link's change in positions,
    over lengths squared."""
    zero = Real(0.0)
    u_i = u[begin]
    v_i = v[begin]
    w_i = w[begin]
    d_before = Vec3()
    inverse = zero
    known = zero
    left_out = zero
    for s in range(begin, end - 1):
        u_j = u[s + 1]
        v_j = v[s + 1]
        w_j = w[s + 1]
        d = (x[s + 1] - x[s]) + (u_j - u_i)
        size = wp.dot(d, d)
        off = -w_i * wp.dot(d_before, d)
        square = off * off
        diagonal = (w_i + w_j) * size
        lower[s] = off * inverse
        pivot = diagonal - square * inverse  # not off * coupling, which would be one multiplication later
        rigid = bool(True)
        if compliance:
            rigid = compliance[s] == zero
        known_before = known
        inverse = zero
        known = zero
        if rigid:
            c = wp.dot(d, v_j - v_i)
            if not of_velocities:
                rest = rest_length[s]
                c = Real(0.5) * (size - rest * rest)
            rhs = -c - off * known_before
            if pivot > vanishing * diagonal:
                inverse = Real(1.0) / pivot
                known = rhs * inverse
            elif diagonal > zero:
                left_out = wp.max(left_out, wp.abs(rhs) / size)
        direction[s] = d
        y[s] = known
        d_before = d
        u_i = u_j
        v_i = v_j
        w_i = w_j

    coupling = zero
    lam = zero
    ahead = Vec3()
    change = Vec3()
    largest = zero
    for r in range(end - 1 - begin):
        s = end - 2 - r
        lam = y[s] - coupling * lam
        coupling = lower[s]
        pull = lam * direction[s]
        change_j = w[s + 1] * (pull - ahead)
        if of_velocities:
            v[s + 1] = v[s + 1] + change_j
        else:
            u[s + 1] = u[s + 1] + change_j
            if r > 0:
                turn = change_j - change
                largest = wp.max(largest, wp.dot(turn, turn) / (rest_length[s + 1] * rest_length[s + 1]))
        change = change_j
        ahead = pull
    change_i = -(w[begin] * ahead)
    if of_velocities:
        v[begin] = v[begin] + change_i
    else:
        u[begin] = u[begin] + change_i
        if end - begin > 1:
            turn = change - change_i
            largest = wp.max(largest, wp.dot(turn, turn) / (rest_length[begin] * rest_length[begin]))
    return left_out, largest
