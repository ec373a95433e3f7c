"""A Newton step (newton.py), back: what it does to the tiles of a piece, and what it leaves."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.elimination import back
from pbd_warp.kernels.link_row import link_step, point_row
from pbd_warp.kernels.pieces import Links, Matrix, Particles, Points, Schedule, Touching
from pbd_warp.kernels.touch import CURVED, OPEN, contact_step, gap_now


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
            left = -gap / (tolerated + relative * scale)
            switched = switched or left > wp.float64(1.0)
        else:
            gap, n, curvature = gap_now(p.move[t] - du, c.side[k], c.start[k], c.led[k], c.surface[k])
            now, push, hold, left = contact_step(
                c.status[k], gap, n, curvature, p.move[t] - c.led[k], du, c.lam[k], c.grip[k], c.surface[k][2],
                p.stiffness[t] / touch, p.stiffness[t] / wp.max(touch, c.rubs), p.weight[t],
                wp.float64(CURVED) * p.stiffness[t], lagging,
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
    links: Links,
    points: Points,
    c: Touching,
    rigid: wp.bool,
    mean_gradient: wp.bool,
    touch: wp.float64,
    lagging: wp.bool,
    mean_length: wp.float64,
    tolerance: wp.float64,
    relative: wp.float64,
    close: wp.float64,
):
    """The step of all tiles, in move and the multipliers.

    What is left of links and points, and of contacts, over what is tolerated, how far the ends of a link moved apart
    over its length, how far one gives over its length, the largest of each; whether contacts switched or are about to,
    and whether there are any."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    error = zero
    widest = zero
    gave = zero
    contact = zero
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
            f = links.fixed[q]
            row = links.row[q]
            steadies = links.steadies[q]
            if not rigid:
                steadies = zero
            if f[0] == zero or row[3] < zero:
                d = links.start[q] + here
                if r >= 0:
                    d = d - p.move[r]
                if f[0] > zero:  # a point for this iteration
                    links.lam[q] = -row[1] * wp.length(d)
                    error = wp.float64(wp.inf)
                    continue
                soft = f[1]
                steadies = links.proximal[q]
                if not rigid:
                    soft = soft + links.elastic[q]
                    steadies = zero
                if mean_gradient and f[1] > zero:
                    d = d + links.before[q]
                    soft = soft + f[1]
                e, pull = point_row(d, links.vector_lam[q], soft, steadies)
                left = wp.max(one / e - soft, zero) * wp.length(pull - links.vector_lam[q])
                error = wp.max(error, left / (tolerance + relative * mean_length))
                links.vector_lam[q] = pull
            elif f[3] > zero:
                lam, left, far = link_step(apart, links.normal[q], row, f, links.lam[q], steadies, tolerance, relative)
                links.lam[q] = lam
                error = wp.max(error, left)
                # 1 / |d| is in the row.
                widest = wp.max(widest, far * wp.min(row[2], per_length))
                if not rigid:
                    gave = wp.max(gave, links.elastic[q] * wp.abs(lam) / f[0])
        if p.weight[t] > zero:
            if points.first:
                point_steps(t, p, points, rigid)
            if c.head:
                size = wp.max(mean_length, wp.length(p.free[t]))
                left, changed, some = contact_steps(
                    t, s.particle[t], m.b[t], p, c, touch, lagging, size, tolerance, close
                )
                contact = wp.max(contact, left)
                switched = switched or changed
                touches = touches or some
    return error, contact, widest, gave, switched, touches
