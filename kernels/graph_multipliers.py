"""Multipliers of the rigid links of any graph, by an elimination whose order and places are laid out beforehand.

The equations are those of path_multipliers.py: A = J W J^T has a row a link, and links that share a particle i have

    A_kl = s_ik s_il w_i d_k . d_l         s = -1 at the first end of a link, +1 at the second; d = x_second - x_first

A = L D L^T, column by column (left-looking): column j collects from the columns k < j whose factor reaches row j. Links
are numbered in the order of elimination; line_graph.py lays the rest out. A link that the others already determine has
a pivot of 0 up to rounding, and lam = 0.
Source: Davis 2006, Direct Methods for Sparse Linear Systems, sections 4.1 and 4.8; ours.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.path_multipliers import in_block
from pbd_warp.kernels.precision import Real, Vec3, func


@func
def solve_graph(
    # Links of the piece, from..to:
    begin: wp.int32,
    end: wp.int32,
    ends: wp.array[wp.vec2i],
    first: wp.array[wp.int32],  # [link_count + 1] of a column in `row` and `factor`
    row: wp.array[wp.int32],
    row_first: wp.array[wp.int32],  # [link_count + 1] of a row in `row_slot`, `row_column`
    row_slot: wp.array[wp.int32],
    row_column: wp.array[wp.int32],
    shared_first: wp.array[wp.int32],  # [link_count + 1] of a column in `shared_slot`, `shared_place`, `shared_sign`
    shared_slot: wp.array[wp.int32],
    shared_place: wp.array[wp.int32],  # sign (1 + place)
    w: wp.array[Real],
    direction: wp.array[Vec3],
    vanishing: Real,
    where: wp.array[wp.int32],  # [link_count] scratch: slot of a row in the column at hand
    factor: wp.array[Real],  # [slots]
    inverse: wp.array[Real],  # [link_count]
    y: wp.array[Real],  # [link_count] right side; becomes lam
):
    """Returns the largest right side of a link that was left out, over its length squared."""
    zero = Real(0.0)
    left_out = zero
    for j in range(begin, end):
        d = direction[j]
        for t in range(first[j], first[j + 1]):
            where[row[t]] = t
            factor[t] = zero
        for t in range(shared_first[j], shared_first[j + 1]):
            slot = shared_slot[t]
            place = shared_place[t]
            weight = w[wp.abs(place) - 1]
            if place < 0:
                weight = -weight
            factor[slot] = factor[slot] + weight * wp.dot(d, direction[row[slot]])
        size = wp.dot(d, d)
        diagonal = (w[ends[j][0]] + w[ends[j][1]]) * size
        pivot = diagonal
        rhs = y[j]
        for q in range(row_first[j], row_first[j + 1]):
            k = row_column[q]
            slot = row_slot[q]
            l_jk = factor[slot]
            a = l_jk * inverse[k]
            pivot = pivot - a * l_jk
            rhs = rhs - a * y[k]
            for t in range(slot + 1, first[k + 1]):
                place = where[row[t]]
                factor[place] = factor[place] - a * factor[t]
        inverse[j] = zero
        if pivot > vanishing * diagonal:
            inverse[j] = Real(1.0) / pivot
        elif diagonal > zero:
            left_out = wp.max(left_out, wp.abs(rhs) / size)
        y[j] = rhs
    for r in range(end - begin):
        j = end - 1 - r
        lam = y[j]
        for t in range(first[j], first[j + 1]):
            lam = lam - factor[t] * y[row[t]]
        y[j] = lam * inverse[j]
    return left_out


@func
def accelerate_graph(
    begin: wp.int32,
    end: wp.int32,
    link_begin: wp.int32,
    link_end: wp.int32,
    spring_begin: wp.int32,
    spring_end: wp.int32,
    gravity: Vec3,
    ends: wp.array[wp.vec2i],
    first: wp.array[wp.int32],
    row: wp.array[wp.int32],
    row_first: wp.array[wp.int32],
    row_slot: wp.array[wp.int32],
    row_column: wp.array[wp.int32],
    shared_first: wp.array[wp.int32],
    shared_slot: wp.array[wp.int32],
    shared_place: wp.array[wp.int32],
    spring_ends: wp.array[wp.vec2i],
    spring_length: wp.array[Real],
    spring_compliance: wp.array[Real],
    x: wp.array[Vec3],
    w: wp.array[Real],
    u: wp.array[Vec3],
    v: wp.array[Vec3],
    stage: wp.int32,
    stage_count: wp.int32,
    vanishing: Real,
    direction: wp.array[Vec3],
    where: wp.array[wp.int32],
    factor: wp.array[Real],
    inverse: wp.array[Real],
    y: wp.array[Real],
    k: wp.array[Vec3],
):
    """As accelerate_path."""
    zero = Real(0.0)
    for s in range(begin, end):
        free = Vec3()
        if w[s] > zero:
            free = gravity
        k[in_block(s, stage, stage_count)] = free
    for q in range(spring_begin, spring_end):
        i = spring_ends[q][0]
        j = spring_ends[q][1]
        at_i = in_block(i, stage, stage_count)
        at_j = in_block(j, stage, stage_count)
        d = (x[j] - x[i]) + (u[j] - u[i])
        pull = ((spring_length[q] / wp.length(d) - Real(1.0)) / spring_compliance[q]) * d
        k[at_i] = k[at_i] - w[i] * pull
        k[at_j] = k[at_j] + w[j] * pull
    for q in range(link_begin, link_end):
        i = ends[q][0]
        j = ends[q][1]
        at_i = in_block(i, stage, stage_count)
        at_j = in_block(j, stage, stage_count)
        d = (x[j] - x[i]) + (u[j] - u[i])
        rate = v[j] - v[i]
        direction[q] = d
        y[q] = -wp.dot(rate, rate) - wp.dot(d, k[at_j] - k[at_i])
    solve_graph(
        link_begin, link_end, ends, first, row, row_first, row_slot, row_column,
        shared_first, shared_slot, shared_place, w, direction, vanishing, where, factor, inverse, y,
    )  # fmt: skip
    for q in range(link_begin, link_end):
        i = ends[q][0]
        j = ends[q][1]
        at_i = in_block(i, stage, stage_count)
        at_j = in_block(j, stage, stage_count)
        pull = y[q] * direction[q]
        k[at_i] = k[at_i] - w[i] * pull
        k[at_j] = k[at_j] + w[j] * pull


@func
def correct_graph(
    link_begin: wp.int32,
    link_end: wp.int32,
    of_velocities: wp.bool,
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
    x: wp.array[Vec3],
    w: wp.array[Real],
    vanishing: Real,
    direction: wp.array[Vec3],
    where: wp.array[wp.int32],
    factor: wp.array[Real],
    inverse: wp.array[Real],
    y: wp.array[Real],
    u: wp.array[Vec3],
    v: wp.array[Vec3],
):
    """As correct_path."""
    for q in range(link_begin, link_end):
        i = ends[q][0]
        j = ends[q][1]
        d = (x[j] - x[i]) + (u[j] - u[i])
        direction[q] = d
        if of_velocities:
            y[q] = -wp.dot(d, v[j] - v[i])
        else:
            y[q] = Real(-0.5) * (wp.dot(d, d) - length[q] * length[q])
    left_out = solve_graph(
        link_begin, link_end, ends, first, row, row_first, row_slot, row_column,
        shared_first, shared_slot, shared_place, w, direction, vanishing, where, factor, inverse, y,
    )  # fmt: skip
    largest = Real(0.0)
    for q in range(link_begin, link_end):
        i = ends[q][0]
        j = ends[q][1]
        pull = y[q] * direction[q]
        if of_velocities:
            v[i] = v[i] - w[i] * pull
            v[j] = v[j] + w[j] * pull
        else:
            u[i] = u[i] - w[i] * pull
            u[j] = u[j] + w[j] * pull
    if not of_velocities:
        for q in range(link_begin, link_end):
            i = ends[q][0]
            j = ends[q][1]
            turn = ((x[j] - x[i]) + (u[j] - u[i])) - direction[q]
            largest = wp.max(largest, wp.dot(turn, turn) / (length[q] * length[q]))
    return left_out, largest
