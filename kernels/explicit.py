"""A whole frame of an explicit Runge-Kutta method on accelerations, one thread a connected piece.

A step of length h from x, v, with the accelerations k_s of its stages (a, b: the method's coefficients):

    x_s = x + c_s h v + h^2 sum_j (a a)_sj k_j      v_s = v + h sum_j a_sj k_j      k_s = acceleration(x_s, v_s)
    u   =         h v + h^2 sum_j (b a)_j  k_j      v'  = v + h sum_j b_j  k_j

Then x + u goes back onto the lengths and v' onto their tangent. An estimate of the error of u chooses h: two embedded
results of lower order differ from u by e5 and e3, and |e5|^2 / sqrt(|e5|^2 + 0.01 |e3|^2) shrinks as h^8.
Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, sections II.4, II.5 (DOP853) and II.14
(Nystroem's form); the projection is Eich's coordinate projection, in the metric of the masses.

Particles that are held (no mass, grabbed, or locked to a point) move through the frame with a constant velocity.
Fails when: nothing satisfies the lengths. The piece then stays where its last good step left it, and is counted.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.path_multipliers import accelerate_path, correct_path
from pbd_warp.kernels.precision import Real, Vec3, func, kernel

SAFETY = wp.constant(0.9)
LARGEST_GROWTH = wp.constant(5.0)
LARGEST_CUT = wp.constant(0.2)
"""Of a step's length from one to the next: the usual ones (Hairer, Norsett, Wanner I, section II.4)."""

CORRECTIONS = wp.constant(8)
"""Newton iterations that put positions onto the lengths, at most: quadratic, from an error as small as a step's."""


@func
def finish(
    begin: wp.int32,
    end: wp.int32,
    stage_count: wp.int32,
    to_position: wp.array[Real],
    to_velocity: wp.array[Real],
    h: Real,
    k: wp.array[Vec3],
    v: wp.array[Vec3],
    u: wp.array[Vec3],
    v_next: wp.array[Vec3],
):
    """The step's displacement and velocity; returns the estimate of its error [m], not a number where it has none."""
    row = stage_count * stage_count
    row5 = row + stage_count
    row3 = row5 + stage_count
    worst5 = Real(0.0)
    worst3 = Real(0.0)
    sum = Real(0.0)
    for s in range(begin, end):
        p = Vec3()
        dv = Vec3()
        e5 = Vec3()
        e3 = Vec3()
        for j in range(stage_count):
            a = k[s * stage_count + j]
            p = p + to_position[row + j] * a
            dv = dv + to_velocity[row + j] * a
            e5 = e5 + to_position[row5 + j] * a
            e3 = e3 + to_position[row3 + j] * a
        v_s = v[s]
        u[s] = h * (v_s + h * p)
        v_next[s] = v_s + h * dv
        square = wp.dot(e5, e5)
        worst5 = wp.max(worst5, square)
        worst3 = wp.max(worst3, wp.dot(e3, e3))
        sum = sum + square
    estimate = Real(0.0)
    if not (sum <= Real(0.0)):
        estimate = h * h * worst5 / wp.sqrt(worst5 + Real(0.01) * worst3)
        if not wp.isfinite(sum):
            estimate = sum
    return estimate


@func
def project(
    begin: wp.int32,
    end: wp.int32,
    round_off: Real,
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
    """x + u onto the lengths and v onto their tangent; whether that could be done."""
    done = bool(False)
    for _correction in range(CORRECTIONS):
        if not done:
            error, change = correct_path(
                begin, end, False, rest_length, compliance, x, w, vanishing, direction, lower, y, u, v
            )
            # What a Newton step leaves is half the square of what it turned a link by.
            done = change <= round_off
            if not (change <= Real(1.0)):
                return False
    correct_path(begin, end, True, rest_length, compliance, x, w, vanishing, direction, lower, y, u, v)
    return done


@kernel
def make_frame(
    # Model:
    gravity: Vec3,  # [m/s^2]
    first: wp.array[wp.int32],  # [piece_count + 1] where each piece begins in `vertex`
    vertex: wp.array[wp.int32],  # [place_count] particles, one piece after the other, along the paths
    rest_length: wp.array[Real],  # [place_count] of the link to the next place (of the last: unused) [m]
    compliance: wp.array[Real],  # [place_count] of the same [m/N], or None: all rigid
    point: wp.array[wp.int32],  # [place_count] point constraint that locks the place, -1 for none; or None: no points
    target: wp.array[Vec3],  # [point_count] [m]
    # Method:
    stage_count: wp.int32,
    to_position: wp.array[Real],  # [stage_count + 3, stage_count] a a; b a; those of e5; of e3
    to_velocity: wp.array[Real],  # [stage_count + 1, stage_count] a; b
    stage_time: wp.array[Real],  # [stage_count] c
    error: Real,  # what a step may be off, a second of its length [m/s]; 0: all steps are `longest`
    longest: Real,  # step, as part of the frame
    most: wp.int32,  # steps in a frame
    round_off: Real,  # of one operation, relative
    vanishing: Real,  # pivot, relative to its diagonal
    # In:
    dt: Real,  # of the frame [s]
    mass_inverse: wp.array[Real],  # [particle_count] [1/kg], 0 of the grabbed one too
    grabbed: wp.array[wp.int32],  # [1]
    grab_target: wp.array[Vec3],  # [1] at the end of the frame [m]
    # State:
    particle_x: wp.array[Vec3],  # [particle_count] [m]
    particle_v: wp.array[Vec3],  # [particle_count] [m/s]
    step: wp.array[Real],  # [piece_count] the next step's length, as part of the frame
    # Scratch, [place_count]:
    x: wp.array[Vec3],
    v: wp.array[Vec3],
    w: wp.array[Real],
    u: wp.array[Vec3],
    v_next: wp.array[Vec3],
    direction: wp.array[Vec3],
    lower: wp.array[Real],
    y: wp.array[Real],
    k: wp.array[Vec3],  # [place_count, stage_count] accelerations [m/s^2]
    # Out:
    steps_used: wp.array[wp.int32],  # [piece_count] those thrown away too
    failed: wp.array[wp.int32],  # [1] pieces that did not get to the end of the frame
):
    p = wp.tid()
    begin = first[p]
    end = first[p + 1]
    zero = Real(0.0)
    one = Real(1.0)

    for s in range(begin, end):
        i = vertex[s]
        x_s = particle_x[i]
        v_s = particle_v[i]
        w_s = mass_inverse[i]
        if point:
            if point[s] >= 0:
                w_s = zero
                v_s = (target[point[s]] - x_s) / dt
        if i == grabbed[0]:
            w_s = zero
            v_s = (grab_target[0] - x_s) / dt
        x[s] = x_s
        v[s] = v_s
        w[s] = w_s
        u[s] = Vec3()
    # What is held may have changed its velocity: the links follow at once.
    good = project(begin, end, round_off, rest_length, compliance, x, w, vanishing, direction, lower, y, u, v)
    for s in range(begin, end):
        x[s] = x[s] + u[s]

    left = one
    length = longest
    if error > zero:
        length = step[p]
    used = int(0)
    first_stage = int(0)
    while good and left > zero and used < most:
        used = used + 1
        count = wp.max(wp.ceil(left / length - Real(0.01)), one)
        part = left / count
        h = part * dt
        for stage in range(first_stage, stage_count):
            accelerate_path(
                begin, end, gravity, rest_length, compliance, x, v, w,
                stage, stage_count, to_position, to_velocity, stage_time[stage], h,
                vanishing, direction, lower, y, k,
            )  # fmt: skip
        estimate = finish(begin, end, stage_count, to_position, to_velocity, h, k, v, u, v_next)

        accepted = bool(True)
        if error > zero:
            allowed = error * h
            change = Real(LARGEST_CUT)
            if estimate <= allowed:
                change = Real(LARGEST_GROWTH)
                if estimate > zero:
                    change = wp.min(change, Real(SAFETY) * wp.pow(allowed / estimate, Real(1.0 / 7.0)))
            else:
                accepted = False
                if wp.isfinite(estimate):
                    change = wp.max(change, Real(SAFETY) * wp.pow(allowed / estimate, Real(1.0 / 7.0)))
        if accepted:
            accepted = project(
                begin, end, round_off, rest_length, compliance, x, w, vanishing, direction, lower, y, u, v_next
            )
            if error == zero:
                good = accepted
            elif not accepted:
                change = Real(LARGEST_CUT)
        if error > zero:
            if accepted and change > one:
                # After a step that was cut to fit the frame the length before counts, where it is greater.
                length = wp.min(wp.max(length, part * change), longest)
                if first_stage == 1:
                    length = wp.min(length, part)
            else:
                length = part * change
        first_stage = 1
        if accepted:
            first_stage = 0
            left = left - part
            if count == one:
                left = zero
            for s in range(begin, end):
                x[s] = x[s] + u[s]
                v[s] = v_next[s]

    step[p] = length
    steps_used[p] = used
    if left > zero:
        wp.atomic_add(failed, 0, 1)
    for s in range(begin, end):
        i = vertex[s]
        x_s = x[s]
        if i == grabbed[0]:
            x_s = grab_target[0]
        if point:
            if point[s] >= 0:
                x_s = target[point[s]]
        particle_x[i] = x_s
        particle_v[i] = v[s]
