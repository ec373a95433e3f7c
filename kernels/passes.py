"""A Newton step (newton.py) over the tiles of a piece: forward its rows and their elimination, back what it does to them.

Each is one function with the loop in it: Warp copies structs into calls, and a call a tile would cost as much as the tile.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.elimination import back, divide_tile, factor_tile, forward, forward_tile, pivot
from pbd_warp.kernels.link_row import link_row, link_step, point_row
from pbd_warp.kernels.pieces import Links, Matrix, Particles, Points, Schedule, Touching
from pbd_warp.kernels.touch import OPEN, SLIDES, contact_row, contact_step, gap_now

CURVED = wp.constant(0.2)
"""Of a particle's inertia: the negative stiffness that the curvature of a surface may have."""


@wp.func
def point_rows(t: wp.int32, p: Particles, points: Points, rigid: wp.bool):
    """What the points of tile t add to its diagonal, and their force."""
    total = wp.float64(0.0)
    force = wp.vec3d()
    for q in range(points.first[t], points.first[t + 1]):
        k = points.which[q]
        soft = points.soft[k]
        if not rigid:
            soft = soft + p.give[t]
        e, pull = point_row(points.gone[k] + p.move[t], points.lam[k], soft, p.give[t])
        total = total + e
        force = force + pull
    return total, force


@wp.func
def contact_rows(t: wp.int32, i: wp.int32, p: Particles, c: Touching, touch: wp.float64, lagging: wp.bool):
    """What the contacts of tile t add to its block, their force, and whether one slides."""
    M = wp.mat33d()
    force = wp.vec3d()
    slides = bool(False)
    inertia = wp.float64(1.0) / p.weight[t]
    k = c.head[i]
    while k >= 0:
        gap, n, curvature = gap_now(p.move[t], c.side[k], c.start[k], c.led[k], c.surface[k])
        if c.status[k] == OPEN and gap < wp.float64(0.0):
            c.status[k] = SLIDES
        if c.status[k] != OPEN:
            slip = p.move[t] - c.led[k]
            slip = slip - wp.dot(n, slip) * n
            block, push = contact_row(
                c.status[k], gap, n, curvature, slip, c.lam[k], c.grip[k], c.surface[k][2],
                inertia / touch, wp.float64(CURVED) * inertia, lagging,
            )  # fmt: skip
            M = M + block
            force = force + push
            slides = slides or c.status[k] == SLIDES
        k = c.following[k]
    return M, force, slides


@wp.func
def forward_pass(
    begin: wp.int32,
    end: wp.int32,
    s: Schedule,
    m: Matrix,
    p: Particles,
    l: Links,
    points: Points,
    c: Touching,
    rigid: wp.bool,
    mean_gradient: wp.bool,
    short: wp.float64,
    touch: wp.float64,
    lagging: wp.bool,
):
    """Rows of the tiles in their order, factors, and the right side as far as them. A link is brought in by the first of
    its ends: to both diagonals and forces, and where both meet."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    identity = wp.identity(3, dtype=wp.float64)
    for t in range(begin, end):
        for k in range(s.column_first[t], s.column_first[t + 1]):
            m.where[s.row[k]] = k
            if s.filled[k] == 1:
                m.low[k] = wp.mat33d()
                m.up[k] = wp.mat33d()
        weight = p.weight[t]
        here = p.move[t]
        A = m.D[t]
        z = m.b[t]
        m.D[t] = wp.mat33d()
        for q in range(s.link_first[t], s.link_first[t + 1]):
            r = s.other[q]
            d = l.start[q] + here
            if r >= 0:
                d = d - p.move[r]
            f = l.fixed[q]
            yields = zero
            if not rigid:
                yields = l.elastic[q]
            if f[0] > zero:
                before = d
                if mean_gradient:
                    before = l.before[q]
                M, force, n, row = link_row(
                    d, before, f[0], f[1], f[2], l.lam[q], l.firm[q], yields, l.softest[q], short, mean_gradient
                )
                l.normal[q] = n
                l.row[q] = row
            else:
                soft = f[1] + yields
                if mean_gradient and f[1] > zero:
                    d = d + l.before[q]
                    soft = soft + f[1]
                steadies = l.proximal[q]
                if not rigid:
                    steadies = zero
                e, force = point_row(d, l.vector_lam[q], soft, steadies)
                M = e * identity
            A = A + M
            z = z + force
            if r >= 0:
                m.D[r] = m.D[r] + M
                m.b[r] = m.b[r] - force
                if weight == zero or p.weight[r] == zero:
                    M = wp.mat33d()
                k = s.slot[q]
                if s.fresh[q] == 1:
                    m.low[k] = -M
                    m.up[k] = -M
                else:
                    m.low[k] = m.low[k] - M
                    m.up[k] = m.up[k] - M
        if weight == zero:
            m.b[t] = wp.vec3d()
            m.F[t] = wp.mat33d()
        else:
            inertia = p.mass[t]
            z = z - inertia * (here - p.free[t])
            slides = bool(False)
            if points.first:
                stiffness, pull = point_rows(t, p, points, rigid)
                inertia = inertia + stiffness
                z = z + pull
            A = A + inertia * identity
            if c.head:
                M, force, sliding = contact_rows(t, s.particle[t], p, c, touch, lagging)
                A = A + M
                z = z + force
                slides = sliding
            for q in range(s.row_first[t], s.row_first[t + 1]):
                place = s.row_slot[q]
                column = s.row_column[q]
                X = m.low[place]
                Y = m.up[place]
                A = A - X * Y
                z = z - X * m.b[column]
                for k in range(place + 1, s.column_first[column + 1]):
                    to = m.where[s.row[k]]
                    m.low[to] = m.low[to] - m.low[k] * Y
                    m.up[to] = m.up[to] - X * m.up[k]
            if slides:
                P = pivot(A)
                A = P * A
                z = P * z
                for k in range(s.column_first[t], s.column_first[t + 1]):
                    m.up[k] = P * m.up[k]
            factors = factor_tile(A)
            m.F[t] = factors
            m.b[t] = forward(factors, z)
            for k in range(s.column_first[t], s.column_first[t + 1]):
                m.low[k] = divide_tile(m.low[k], factors)
                m.up[k] = forward_tile(factors, m.up[k])


@wp.func
def point_steps(t: wp.int32, p: Particles, points: Points, rigid: wp.bool):
    """lam of the points of tile t."""
    for q in range(points.first[t], points.first[t + 1]):
        k = points.which[q]
        soft = points.soft[k]
        if not rigid:
            soft = soft + p.give[t]
        e, pull = point_row(points.gone[k] + p.move[t], points.lam[k], soft, p.give[t])
        points.lam[k] = pull


@wp.func
def contact_steps(
    t: wp.int32,
    i: wp.int32,
    du: wp.vec3d,
    p: Particles,
    c: Touching,
    touch: wp.float64,
    lagging: wp.bool,
    scale: wp.float64,
    tolerance: wp.float64,
    relative: wp.float64,
):
    """Status, lam and friction of the contacts of tile t; what is left of them over what is tolerated, at most, whether
    any changed its status or is about to, and whether there are any."""
    zero = wp.float64(0.0)
    error = zero
    switched = bool(False)
    touches = bool(False)
    k = c.head[i]
    while k >= 0:
        tolerated = tolerance + c.surface[k][3]
        if c.status[k] == OPEN:
            gap, n, curvature = gap_now(p.move[t], c.side[k], c.start[k], c.led[k], c.surface[k])
            switched = switched or gap < -(tolerated + relative * scale)
        else:
            gap, n, curvature = gap_now(p.move[t] - du, c.side[k], c.start[k], c.led[k], c.surface[k])
            now, push, hold, left = contact_step(
                c.status[k], gap, n, curvature, p.move[t] - c.led[k], du, c.lam[k], c.grip[k], c.surface[k][2],
                wp.float64(1.0) / (touch * p.weight[t]), p.weight[t], wp.float64(CURVED), lagging,
                scale, tolerated, relative,
            )  # fmt: skip
            switched = switched or (now != c.status[k] and left > wp.float64(1.0))
            touches = True
            c.status[k] = now
            c.lam[k] = push
            c.grip[k] = hold
            error = wp.max(error, left)
        k = c.following[k]
    return error, switched, touches


@wp.func
def back_pass(
    begin: wp.int32,
    end: wp.int32,
    s: Schedule,
    m: Matrix,
    p: Particles,
    l: Links,
    points: Points,
    c: Touching,
    rigid: wp.bool,
    mean_gradient: wp.bool,
    touch: wp.float64,
    lagging: wp.bool,
    mean_length: wp.float64,
    tolerance: wp.float64,
    relative: wp.float64,
    loose: wp.float64,
):
    """The step of all tiles, in move and the multipliers. What is left over what is tolerated; how far the ends of a link
    moved apart over its length; how far one gives over its length: the largest of each. Whether contacts switched or are
    about to, and whether there are any. What is left after a Newton step is of second order in it, so it tells itself.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    error = zero
    widest = zero
    gave = zero
    switched = bool(False)
    touches = bool(False)
    per_length = one / mean_length
    for o in range(end - begin):
        t = end - 1 - o
        z = m.b[t]
        for k in range(s.column_first[t], s.column_first[t + 1]):
            z = z - m.up[k] * m.b[s.row[k]]
        du = back(m.F[t], z)
        m.b[t] = du
        here = p.move[t] + du
        p.move[t] = here
        for q in range(s.link_first[t], s.link_first[t + 1]):
            r = s.other[q]
            apart = du
            if r >= 0:
                apart = apart - m.b[r]
            f = l.fixed[q]
            row = l.row[q]
            steadies = l.steadies[q]
            if not rigid:
                steadies = zero
            if f[0] == zero or row[3] < zero:
                d = l.start[q] + here
                if r >= 0:
                    d = d - p.move[r]
                if f[0] > zero:  # a point for this iteration
                    l.lam[q] = -row[1] * wp.length(d)
                    error = wp.float64(wp.inf)
                    continue
                soft = f[1]
                steadies = l.proximal[q]
                if not rigid:
                    soft = soft + l.elastic[q]
                    steadies = zero
                if mean_gradient and f[1] > zero:
                    d = d + l.before[q]
                    soft = soft + f[1]
                e, pull = point_row(d, l.vector_lam[q], soft, steadies)
                left = wp.max(one / e - soft, zero) * wp.length(pull - l.vector_lam[q])
                error = wp.max(error, left / (tolerance + relative * mean_length))
                l.vector_lam[q] = pull
            elif f[3] > zero:
                lam, left, far = link_step(apart, l.normal[q], row, f, l.lam[q], steadies, tolerance, relative)
                l.lam[q] = lam
                error = wp.max(error, left)
                # 1 / |d| is in the row.
                widest = wp.max(widest, far * wp.min(row[2], per_length))
                if not rigid:
                    gave = wp.max(gave, l.elastic[q] * wp.abs(lam) / f[0])
        if p.weight[t] > zero:
            if points.first:
                point_steps(t, p, points, rigid)
            if c.head:
                size = wp.max(mean_length, wp.length(p.free[t]))
                left, changed, some = contact_steps(t, s.particle[t], m.b[t], p, c, touch, lagging, size, tolerance, loose)
                error = wp.max(error, left)
                switched = switched or changed
                touches = touches or some
    return error, widest, gave, switched, touches
