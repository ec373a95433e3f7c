"""Stages, results and step lengths of explicit Runge-Kutta methods on accelerations: formulas in explicit.py."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Block, Real, Vec3, func

SAFETY = wp.constant(0.9)
LARGEST_GROWTH = wp.constant(5.0)
LARGEST_CUT = wp.constant(0.2)
"""Of a step's length from one to the next: the usual ones (Hairer, Norsett, Wanner I, section II.4)."""


@func
def advance(
    begin: wp.int32,  # blocks
    end: wp.int32,
    stage: wp.int32,
    stage_count: wp.int32,
    to_position: wp.array[Real],
    to_velocity: wp.array[Real],
    time: Real,
    h: Real,
    k: wp.array[Block],
    v: wp.array[Block],
    u_next: wp.array[Block],
    v_next: wp.array[Block],
):
    """Displacements since the start of the step, and velocities, in a stage, or at the end, that of stage_count."""
    for m in range(begin, end):
        p = Block()
        dv = Block()
        for j in range(stage):
            a = k[m * stage_count + j]
            p = p + to_position[stage * stage_count + j] * a
            dv = dv + to_velocity[stage * stage_count + j] * a
        v_m = v[m]
        u_next[m] = h * (time * v_m + h * p)
        v_next[m] = v_m + h * dv


@func
def combine(
    begin: wp.int32,
    end: wp.int32,
    stage_count: wp.int32,
    to_estimate: wp.array[Real],
    k: wp.array[Block],
    error5: wp.array[Block],
    error3: wp.array[Block],
):
    """What the embedded results are off by, over the step's length squared."""
    for m in range(begin, end):
        e5 = Block()
        e3 = Block()
        for j in range(stage_count):
            a = k[m * stage_count + j]
            e5 = e5 + to_estimate[j] * a
            e3 = e3 + to_estimate[stage_count + j] * a
        error5[m] = e5
        error3[m] = e3


@func
def largest(begin: wp.int32, end: wp.int32, a: wp.array[Vec3]):
    """The largest square, not finite where one is not: a maximum may lose what is not a number."""
    worst = Real(0.0)
    total = Real(0.0)
    for s in range(begin, end):
        square = wp.dot(a[s], a[s])
        worst = wp.max(worst, square)
        total = total + square
    if wp.isfinite(total):
        return worst
    return total


@func
def next_length(estimate: Real, allowed: Real):
    """What the next step's length is of this one's."""
    if not wp.isfinite(estimate):
        return Real(LARGEST_CUT)
    if estimate == Real(0.0):
        return Real(LARGEST_GROWTH)
    change = Real(SAFETY) * wp.pow(allowed / estimate, Real(1.0 / 7.0))
    return wp.clamp(change, Real(LARGEST_CUT), Real(LARGEST_GROWTH))
