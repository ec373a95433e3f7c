"""Newton's method (newton.py) on one piece: what it begins with, what it makes of each iteration, what it leaves."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.pieces import Links, Matrix, Particles, Points, Progress, Schedule
from pbd_warp.kernels.precision import Real, Vec3, func
from pbd_warp.kernels.touch import double

PATIENCE = wp.constant(20)
"""Iterations in which rigid links converge, or the piece is taken for one that has to give."""

TOUCHING = wp.constant(40)
"""The same of pieces that touch something."""

POLISH = wp.constant(6)
"""Iterations in which rigid links converge from where elastic ones did, if they ever do."""

TAUT = wp.constant(1.0e-9)
"""Links that give are no convergence for an integrator that keeps energy, since they take it up: only where they were
too long by more than this part of their length, and half of what they give, before the step."""

STILL = wp.constant(1.0e-9)
"""How far the ends of links move apart in an iteration, over their length, that may be rounding."""

AGAIN = wp.constant(16)
"""Steps of elastic links after which rigid ones are tried again, or where they stretch a quarter of what they did."""

TOUCH = wp.constant(1.0e-2)
"""Over a particle's stiffness: what a contact gives in the first iteration; it firms tenfold in each that follows.
What is stuck to a surface and held together by rigid links has more constraints than unknowns: firm at once, Newton's
errors, of second order, would make forces larger than those of the links, of either sign."""

FIRMEST = wp.constant(1.0e-4)
"""What it gives in the end, but for friction (touches.py)."""

LAG = wp.constant(12)
"""Iterations after which friction is bounded by the push as it was for as many, and so on in turn: contacts that slide
and stick by turns come to rest."""

YIELDING = wp.constant(1.0e-1)
"""What a contact gives at most, tenfold more whenever contacts open, close, stick or slide in such iterations."""


@func
def begin_piece(
    piece: wp.int32,
    s: Schedule,
    rest_length: wp.array[Real],
    compliance: wp.array[Real],
    target: wp.array[Vec3],
    point_compliance: wp.array[Real],
    x: wp.array[Vec3],
    w: wp.array[Real],
    base: wp.array[Vec3],
    soften: wp.float64,
    mean_gradient: wp.bool,
    scale: wp.float64,
    p: Particles,
    links: Links,
    points: Points,
    u: wp.array[Vec3],
):
    """What the iterations of a piece do not change; arguments as of `solve_pieces`."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    for t in range(s.piece_first[piece], s.piece_first[piece + 1]):
        i = s.particle[t]
        p.weight[t] = wp.float64(w[i])
        p.mass[t] = zero
        if p.weight[t] > zero:
            p.mass[t] = one / p.weight[t]
        p.free[t] = double(base[i])
        p.move[t] = double(u[i])
        if p.weight[t] > zero:
            p.move[t] = p.free[t] + scale * p.shift[t]
        for q in range(s.link_first[t], s.link_first[t + 1]):
            j = s.partner[q]
            d = double(x[i]) - double(x[j])
            links.before[q] = d
            links.start[q] = d
            mobility = p.weight[t] + wp.float64(w[j])
            if s.other[q] < 0:
                links.start[q] = d - double(u[j])
                mobility = p.weight[t]
            soft = zero
            if compliance:
                soft = wp.float64(compliance[q]) * soften
            doubled = soft
            if mean_gradient:
                doubled = soft + soft
            steadies = wp.max(links.proximal[q] - doubled, zero)
            links.steadies[q] = steadies
            links.firm[q] = one / (doubled + steadies)
            links.fixed[q] = wp.vec4d(wp.float64(rest_length[q]), soft, wp.length(d), mobility)
            links.lam[q] = links.lam[q] * scale
            if links.vector_lam:
                links.vector_lam[q] = links.vector_lam[q] * scale
        if points.first:
            for q in range(points.first[t], points.first[t + 1]):
                k = points.which[q]
                points.gone[k] = double(x[i]) - double(target[k])
                points.soft[k] = zero
                if point_compliance:
                    points.soft[k] = wp.float64(point_compliance[k]) * soften
                    if mean_gradient and points.soft[k] > zero:  # the mean of C before and after the step, twice
                        points.gone[k] = wp.float64(2.0) * points.gone[k]
                        points.soft[k] = wp.float64(2.0) * points.soft[k]
                points.lam[k] = points.lam[k] * scale


@wp.func
def find_stiffness(begin: wp.int32, end: wp.int32, s: Schedule, p: Particles, links: Links):
    """How firmly particles are held across what they touch: by inertia, and across links by what those carry. What a
    contact gives is a fraction of that, or it would converge at the pace at which rubber takes a load."""
    for t in range(begin, end):
        p.stiffness[t] = p.mass[t]
    for t in range(begin, end):
        for q in range(s.link_first[t], s.link_first[t + 1]):
            L = links.fixed[q][0]
            if L > wp.float64(0.0):
                across = wp.abs(links.lam[q]) / L
                p.stiffness[t] = p.stiffness[t] + across
                if s.other[q] >= 0:
                    p.stiffness[s.other[q]] = p.stiffness[s.other[q]] + across


@wp.func
def first_progress(rigid: wp.bool):
    """Before the first iteration."""
    g = Progress()
    g.rigid = rigid
    g.touch = wp.float64(TOUCH)
    return g


@wp.func
def judge_piece(
    g: Progress,
    piece: wp.int32,
    begin: wp.int32,
    end: wp.int32,
    m: Matrix,
    p: Particles,
    reach: wp.float64,
    lagging: wp.bool,
    left: wp.float64,
    contact: wp.float64,
    widest: wp.float64,
    given: wp.float64,
    switched: wp.bool,
    touches: wp.bool,
):
    """What comes after an iteration that left this (`back_pass`): whether that was all, or links have to give."""
    g.error = left
    g.contact = contact
    g.gave = given
    patience = int(PATIENCE)
    if touches:
        patience = TOUCHING
    # Links that give under forces so large that rounding moves them: steps that are small and shrink no more.
    if not g.rigid and not touches and widest < wp.float64(STILL) and widest > wp.float64(0.25) * g.widest:
        g.error = wp.min(g.error, wp.float64(1.0))
    g.widest = widest
    if not wp.isfinite(m.b[begin]):  # the last that is found: all that is not finite arrives there
        g.error = wp.float64(wp.inf)
    back_off = wp.float64(0.0)
    if widest > reach:
        back_off = wp.float64(1.0) - reach / widest
        g.error = wp.float64(wp.inf)
    for t in range(begin, end):
        p.move[t] = p.move[t] - back_off * m.b[t]
        m.b[t] = wp.vec3d()

    if lagging and switched:
        g.touch = wp.min(wp.float64(10.0) * g.touch, wp.float64(YIELDING))
    else:
        # Those that switch round and round give more each time.
        least = wp.min(
            wp.float64(FIRMEST) * wp.pow(wp.float64(10.0), wp.float64(wp.max(g.used / (2 * LAG) - 1, 0))),
            wp.float64(YIELDING),
        )
        g.touch = wp.max(wp.float64(0.1) * g.touch, least)
    if switched and g.rigid:
        g.began = g.used
    if g.error <= wp.float64(1.0) and g.contact <= wp.float64(1.0):
        if g.rigid:
            p.gives[piece] = 0
            g.done = True
        elif not g.done:
            p.gives[piece] = p.gives[piece] - 1
            if not g.polishing and (p.gives[piece] <= 0 or g.gave < wp.float64(0.25) * p.strain[piece]):
                g.rigid = True
                g.polishing = True
                g.began = g.used
            else:
                if g.polishing:
                    p.gives[piece] = AGAIN
                    p.strain[piece] = g.gave
                g.done = True
    else:
        g.done = False
        if g.rigid and (g.used - g.began >= patience or (g.polishing and g.used - g.began >= POLISH)):
            g.rigid = False
            p.gives[piece] = wp.max(p.gives[piece], 1)
            g.began = g.used
    return g


@func
def end_piece(
    g: Progress,
    piece: wp.int32,
    begin: wp.int32,
    end: wp.int32,
    s: Schedule,
    p: Particles,
    links: Links,
    mean_gradient: wp.bool,
    accepted: wp.float64,
    accepted_contact: wp.float64,
    u: wp.array[Vec3],
    iterations_used: wp.array[wp.int32],
    unconverged: wp.array[wp.int32],
):
    """The displacement found, and whether it is what was asked for; arguments as of `solve_pieces`."""
    error = g.error
    if mean_gradient and not g.rigid:
        longest = wp.float64(0.0)
        for q in range(s.link_first[begin], s.link_first[end]):
            f = links.fixed[q]
            longest = wp.max(longest, f[2] / wp.max(f[0], wp.float64(1.0e-300)) - wp.float64(1.0))
        if longest < wp.float64(TAUT) or g.gave > wp.float64(2.0) * longest:
            error = wp.float64(wp.inf)
    for t in range(begin, end):
        p.shift[t] = p.move[t] - p.free[t]
        u[s.particle[t]] = Vec3(Real(p.move[t][0]), Real(p.move[t][1]), Real(p.move[t][2]))
    wp.atomic_add(iterations_used, 0, g.used)
    if not (error <= accepted and g.contact <= accepted_contact):
        wp.atomic_add(unconverged, 0, 1)
        p.missed[piece] = p.missed[piece] + 1
