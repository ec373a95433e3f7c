"""Whole frames of an explicit Runge-Kutta method on accelerations, one thread a connected piece.

A step of length h from x, v, with the accelerations k_s of its stages (a, b, c: the method's coefficients):

    x_s = x + c_s h v + h^2 sum_j (a a)_sj k_j      v_s = v + h sum_j a_sj k_j      k_s = acceleration(x_s, v_s)
    u   =         h v + h^2 sum_j (b a)_j  k_j      v'  = v + h sum_j b_j  k_j

Then x + u goes back onto the lengths and v' onto their tangent. An estimate of the error chooses h: two embedded
results of lower order are off by e5 and e3, and |e5|^2 / sqrt(|e5|^2 + 0.01 |e3|^2) shrinks as h^8.
Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, sections II.4, II.5 (DOP853) and II.14
(positions without the stages' velocities: Nystroem's form). The projection is that of Lubich, Eich, Fuehrer in Hairer,
Wanner II, section VII.2, in the metric of the masses.

Particles without mass, or locked to a point, move through the frame with a constant velocity.
Fails when: nothing satisfies the lengths, or no step is short enough for `error`. The piece then stays where its last
good step left it, and its first particle is noted in `diverged`.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.divergence import PIECE
from pbd_warp.kernels.graph_multipliers import accelerate_graph, correct_graph
from pbd_warp.kernels.path_multipliers import accelerate_path, correct_path
from pbd_warp.kernels.precision import BLOCK, Block, Real, Vec3, func, kernel
from pbd_warp.kernels.runge_kutta import LARGEST_CUT, advance, combine, largest, next_length

PESSIMISM = wp.constant(2.0)
"""An estimate may be so many times `error` h: what such steps add up to in a second was then, on random chains, between
a hundredth of `error` and all of it, but for what the motion itself makes of it (accuracy/agreement.py)."""

CORRECTIONS = wp.constant(8)
"""Newton iterations that put positions onto the lengths, at most: quadratic, from an error as small as a step's."""


@func
def project(
    begin: wp.int32,
    end: wp.int32,
    is_path: wp.bool,
    link_begin: wp.int32,
    link_end: wp.int32,
    rest_length: wp.array[Real],
    compliance: wp.array[Real],
    ends: wp.array[wp.vec2i],
    length: wp.array[Real],
    first: wp.array[wp.int32],
    row: wp.array[wp.int32],
    row_first: wp.array[wp.int32],
    row_slot: wp.array[wp.int32],
    row_column: wp.array[wp.int32],
    shared_first: wp.array[wp.int32],
    shared_slot: wp.array[wp.int32],
    shared_place: wp.array[wp.int32],
    round_off: Real,
    vanishing: Real,
    x: wp.array[Vec3],
    w: wp.array[Real],
    direction: wp.array[Vec3],
    lower: wp.array[Real],
    y: wp.array[Real],
    where: wp.array[wp.int32],
    factor: wp.array[Real],
    link_direction: wp.array[Vec3],
    link_inverse: wp.array[Real],
    link_y: wp.array[Real],
    u: wp.array[Vec3],
    v: wp.array[Vec3],
):
    """x + u onto the lengths and v onto their tangent; whether that could be done."""
    on_lengths = bool(False)
    done = bool(False)
    corrections = int(0)
    while not done and corrections <= CORRECTIONS:
        corrections = corrections + 1
        left_out = Real(0.0)
        change = Real(0.0)
        if is_path:
            left_out, change = correct_path(
                begin, end, on_lengths, rest_length, compliance, x, w, vanishing, direction, lower, y, u, v
            )
        else:
            left_out, change = correct_graph(
                link_begin, link_end, on_lengths,
                ends, length, first, row, row_first, row_slot, row_column, shared_first, shared_slot, shared_place,
                x, w, vanishing, link_direction, where, factor, link_inverse, link_y, u, v,
            )  # fmt: skip
        if on_lengths:
            done = True  # that was the velocities' turn
        elif not (change <= Real(1.0)):
            corrections = int(CORRECTIONS) + 1
        else:  # what a Newton step leaves is half the square of what it turned a link by
            on_lengths = change <= round_off and left_out * left_out <= round_off
    return done


@kernel
def make_frame(
    # Model:
    gravity: Vec3,  # [m/s^2]
    piece_first: wp.array[wp.int32],  # [piece_count] where each piece begins in `vertex`, a multiple of BLOCK
    piece_end: wp.array[wp.int32],  # [piece_count] and ends
    vertex: wp.array[wp.int32],  # [place_count] particles, one piece after the other, along the paths
    point: wp.array[wp.int32],  # [place_count] point constraint that locks the place, -1 for none; or None: no points
    target: wp.array[Vec3],  # [point_count] [m]
    # Model, paths:
    path: wp.array[wp.int32],  # [piece_count] 1 for a path
    rest_length: wp.array[Real],  # [place_count] of the link to the next place [m]
    compliance: wp.array[Real],  # [place_count] of the same [m/N], or None: all rigid
    # Model, other graphs (line_graph.py):
    link_first: wp.array[wp.int32],  # [piece_count + 1] a piece's rigid links
    ends: wp.array[wp.vec2i],  # [link_count] places
    length: wp.array[Real],  # [link_count] [m]
    first: wp.array[wp.int32],
    row: wp.array[wp.int32],
    row_first: wp.array[wp.int32],
    row_slot: wp.array[wp.int32],
    row_column: wp.array[wp.int32],
    shared_first: wp.array[wp.int32],
    shared_slot: wp.array[wp.int32],
    shared_place: wp.array[wp.int32],
    spring_first: wp.array[wp.int32],  # [piece_count + 1] a piece's compliant distances
    spring_ends: wp.array[wp.vec2i],  # [spring_count] places
    spring_length: wp.array[Real],  # [spring_count] [m]
    spring_compliance: wp.array[Real],  # [spring_count] [m/N]
    # Method:
    stage_count: wp.int32,
    stage_time: wp.array[Real],  # [stage_count + 1] c; 1
    to_position: wp.array[Real],  # [stage_count + 1, stage_count] a a; b a
    to_velocity: wp.array[Real],  # [stage_count + 1, stage_count] a; b
    to_estimate: wp.array[Real],  # [2, stage_count] e5; e3
    error: Real,  # what a step may be off, a second of its length [m/s]; 0: all steps are `longest`
    longest: Real,  # step, as part of the frame
    most: wp.int32,  # steps in a frame
    round_off: Real,  # of one operation, relative
    vanishing: Real,  # pivot, relative to its diagonal
    # In:
    dt: Real,  # of the frame [s]
    mass_inverse: wp.array[Real],  # [particle_count] [1/kg], 0 of what moves as it is told
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
    error5: wp.array[Vec3],
    error3: wp.array[Vec3],
    k: wp.array[Vec3],  # [blocks, stage_count, BLOCK] accelerations [m/s^2]
    # The same memory, by blocks:
    v_blocks: wp.array[Block],
    u_blocks: wp.array[Block],
    v_next_blocks: wp.array[Block],
    error5_blocks: wp.array[Block],
    error3_blocks: wp.array[Block],
    k_blocks: wp.array[Block],
    # Scratch, [link_count]:
    link_direction: wp.array[Vec3],
    link_inverse: wp.array[Real],
    link_y: wp.array[Real],
    where: wp.array[wp.int32],
    factor: wp.array[Real],  # [slots]
    # Out:
    frames: wp.array[wp.int32],  # [2] wanted, made: more than one only of a single piece
    steps_used: wp.array[wp.int32],  # [piece_count] those thrown away too
    diverged: wp.array[wp.int32],  # [5]: divergence.py
):
    piece = wp.tid()
    begin = piece_first[piece]
    end = piece_end[piece]
    block_begin = begin / BLOCK
    block_end = (end + BLOCK - 1) / BLOCK
    is_path = path[piece] == 1
    link_begin = link_first[piece]
    link_end = link_first[piece + 1]
    zero = Real(0.0)
    one = Real(1.0)

    made = int(0)
    wanted = int(frames[0])
    while made < wanted:
        made = made + 1
        for s in range(begin, end):
            i = vertex[s]
            x_s = particle_x[i]
            v_s = particle_v[i]
            w_s = mass_inverse[i]
            if point:
                if point[s] >= 0:
                    w_s = zero
                    v_s = (target[point[s]] - x_s) / dt
            x[s] = x_s
            v[s] = v_s
            w[s] = w_s
            v_next[s] = v_s
            u[s] = Vec3()

        left = one
        length_next = longest
        if error > zero:
            length_next = step[piece]
        # The first step has no length, a projection: what is held may have changed its velocity, and the links follow.
        used = int(-1)
        good = bool(True)
        again = bool(False)
        while good and left > zero and used < most:
            used = used + 1
            part = zero
            change = one
            accepted = bool(True)
            if used > 0:
                count = wp.max(wp.ceil(left / length_next - Real(0.01)), one)
                part = left / count
                h = part * dt
                first_stage = int(0)
                if again:
                    first_stage = 1  # a step made again begins with the same accelerations
                for stage in range(first_stage, stage_count + 1):
                    advance(
                        block_begin, block_end, stage, stage_count, to_position, to_velocity, stage_time[stage], h,
                        k_blocks, v_blocks, u_blocks, v_next_blocks,
                    )  # fmt: skip
                    if stage < stage_count:
                        if is_path:
                            accelerate_path(
                                begin, end, gravity, rest_length, compliance, x, w, u, v_next,
                                stage, stage_count, vanishing, direction, lower, y, k,
                            )  # fmt: skip
                        else:
                            accelerate_graph(
                                begin, end, link_begin, link_end, spring_first[piece], spring_first[piece + 1], gravity,
                                ends, first, row, row_first, row_slot, row_column, shared_first, shared_slot,
                                shared_place,
                                spring_ends, spring_length, spring_compliance, x, w, u, v_next,
                                stage, stage_count, vanishing, link_direction, where, factor, link_inverse, link_y, k,
                            )  # fmt: skip
                if error > zero:
                    combine(block_begin, block_end, stage_count, to_estimate, k_blocks, error5_blocks, error3_blocks)
                    estimate = largest(begin, end, error5)
                    if estimate > zero and wp.isfinite(estimate):
                        estimate = (h * h) * estimate / wp.sqrt(estimate + Real(0.01) * largest(begin, end, error3))
                    # What of it may be rounding: some of the bent part of the way.
                    bent = zero
                    for s in range(begin, end):
                        way = u[s] - h * v[s]
                        bent = wp.max(bent, wp.dot(way, way))
                    allowed = Real(PESSIMISM) * error * h + round_off * wp.sqrt(bent)
                    accepted = estimate <= allowed
                    change = next_length(estimate, allowed)
            if accepted:
                accepted = project(
                    begin, end, is_path, link_begin, link_end, rest_length, compliance,
                    ends, length, first, row, row_first, row_slot, row_column, shared_first, shared_slot, shared_place,
                    round_off, vanishing, x, w, direction, lower, y,
                    where, factor, link_direction, link_inverse, link_y, u, v_next,
                )  # fmt: skip
                if not accepted:
                    change = Real(LARGEST_CUT)
            if accepted:
                for s in range(begin, end):
                    x[s] = x[s] + u[s]
                    v[s] = v_next[s]
                left = left - part
                if part > zero and left < round_off:
                    left = zero
            if used == 0 or error == zero:
                good = accepted
            elif not accepted or change < one:
                length_next = part * change
                good = length_next > round_off
            elif not again:  # a step that was cut to fit the frame is no reason for shorter ones
                length_next = wp.min(wp.max(length_next, part * change), longest)
            again = not accepted

        step[piece] = wp.max(length_next, round_off)
        steps_used[piece] = used
        if left > zero:
            wp.atomic_min(diverged, PIECE, vertex[begin])
            wanted = made
        for s in range(begin, end):
            i = vertex[s]
            x_s = x[s]
            if point:
                if point[s] >= 0 and left == zero:
                    x_s = target[point[s]]
            particle_x[i] = x_s
            particle_v[i] = v[s]
            if not wp.isfinite(x_s):
                wp.atomic_min(diverged, 0, i)
                wanted = made
    if piece == 0:
        frames[1] = made
