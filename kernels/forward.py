"""A Newton step (newton.py), forward: the rows of all tiles of a piece, and their elimination.

One function with the loop in it: Warp copies structs into calls, and a call a tile would cost as much as the tile.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.elimination import divide_tile, factor_tile, forward, forward_tile, pivot
from pbd_warp.kernels.link_row import link_row, point_row
from pbd_warp.kernels.pieces import Links, Matrix, Particles, Points, Schedule, Touching
from pbd_warp.kernels.touch import CURVED, OPEN, SLIDES, contact_row, gap_now


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
    inertia = p.stiffness[t]
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
                inertia / touch, inertia / wp.max(touch, c.rubs), wp.float64(CURVED) * inertia, lagging,
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
    links: Links,
    points: Points,
    c: Touching,
    rigid: wp.bool,
    mean_gradient: wp.bool,
    short: wp.float64,
    touch: wp.float64,
    lagging: wp.bool,
):
    """Rows of the tiles in their order, factors, and the right side as far as them. A link is brought in by the first
    of its ends: to both diagonals and forces, and where both meet."""
    zero = wp.float64(0.0)
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
            d = links.start[q] + here
            if r >= 0:
                d = d - p.move[r]
            f = links.fixed[q]
            yields = zero
            if not rigid:
                yields = links.elastic[q]
            if f[0] > zero:
                before = d
                if mean_gradient:
                    before = links.before[q]
                M, force, n, row = link_row(
                    d,
                    before,
                    f[0],
                    f[1],
                    f[2],
                    links.lam[q],
                    links.firm[q],
                    yields,
                    links.softest[q],
                    short,
                    mean_gradient,
                )
                links.normal[q] = n
                links.row[q] = row
            else:
                soft = f[1] + yields
                if mean_gradient and f[1] > zero:
                    d = d + links.before[q]
                    soft = soft + f[1]
                steadies = links.proximal[q]
                if not rigid:
                    steadies = zero
                e, force = point_row(d, links.vector_lam[q], soft, steadies)
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
            if m.swap:
                m.swap[t] = identity
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
                if m.swap:
                    m.swap[t] = P
                for k in range(s.column_first[t], s.column_first[t + 1]):
                    m.up[k] = P * m.up[k]
            factors = factor_tile(A)
            m.F[t] = factors
            m.b[t] = forward(factors, z)
            for k in range(s.column_first[t], s.column_first[t + 1]):
                m.low[k] = divide_tile(m.low[k], factors)
                m.up[k] = forward_tile(factors, m.up[k])
