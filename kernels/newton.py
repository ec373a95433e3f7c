"""Newton's method on the momentum balance and all constraints of a piece at once; each step an elimination.

With r the residual of the momentum balance and c that of the constraints, lam their multipliers,

    r_i = (u_i - b_i) / w_i - sum_k s_ik g_k lam_k        s_ik = +1 / -1 for the first / second end of link k
    c_k = C_k + a_k lam_k

one step solves, for du (three unknowns a particle) and dlam (one a link),

    [ 1/w + K   -G ] [ du   ]     [ r ]
    [ J        a+e ] [ dlam ] = - [ c ]

b is the displacement without constraints, a the compliance over the integrator's force scale. The geometric stiffness
K_k = -lam_k dg_k/dd belongs to the turning of links under tension; with it the method converges where projection along
present gradients does not (1000 links, 4 substeps), and what it converges to balances momentum exactly, so that
"midpoint" keeps energy. Of a link that pushes (lam > 0) K is negative: no more of it counts than leaves the matrix
positive, so convergence is quadratic for ropes that are pushed together by little in a step, and linear beyond.

e makes dlam = -(c + J du) / (a + e) eliminable first, which leaves 3 x 3 tiles of particles, whatever the constraints:
redundant, contradictory, more than there are unknowns. In the matrix alone it changes no solution (the proximal method
of multipliers, Rockafellar 1976); each step leaves a small fraction of c. Where lengths cannot be kept with any finite
force (a rope held straight, or further apart than it is long) that does not end, and the piece is solved with its links
elastic, c_k = C_k + e_k lam_k with e_k in proportion to their length: what is too much is spread as along a rubber
band. From there the proximal method is tried once more.
Source: ours, elimination as in elimination.py.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.back import back_pass
from pbd_warp.kernels.forward import forward_pass
from pbd_warp.kernels.link_row import SHORT
from pbd_warp.kernels.pieces import Links, Matrix, Particles, Points, Schedule, Touching
from pbd_warp.kernels.precision import Real, Vec3, kernel
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

TOUCH = wp.constant(1.0e-3)
"""Of a particle's inverse mass: what a contact gives in the first iteration; it firms tenfold in each that follows.
What is stuck to a surface and held together by rigid links has more constraints than unknowns: firm at once, Newton's
errors, of second order, would make forces larger than those of the links, of either sign."""

FIRMEST = wp.constant(1.0e-4)
"""What it gives in the end, of either precision: rounded positions contradict each other too."""

LAG = wp.constant(12)
"""Iterations after which friction is bounded by the push as it was for as many, and so on in turn: contacts that slide
and stick by turns come to rest."""

YIELDING = wp.constant(1.0e-1)
"""What a contact gives at most, tenfold more whenever contacts open, close, stick or slide in such iterations."""

SLACK = wp.constant(1.0e3)
"""Tolerances that the gap and the slip of a contact may be off by."""


@kernel
def solve_pieces(
    # Model:
    s: Schedule,
    rest_length: wp.array[Real],  # [link_count] [m]
    compliance: wp.array[Real],  # [link_count] [m/N], or None: all 0
    target: wp.array[Vec3],  # [point_count] [m]
    point_compliance: wp.array[Real],  # [point_count] [m/N], or None: all 0
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    base: wp.array[Vec3],  # [particle_count] displacement without constraints [m]
    compliance_scale: wp.array[Real],  # [1] 1 / the integrator's force scale [1/s^2]
    mean_gradient: wp.bool,  # force along the mean of the configurations before and after the step
    first: wp.bool,  # in the step: multipliers and u are guesses from the one before, otherwise those of now
    lam_scale: wp.float64,  # takes forces of the step before to this step's scale
    reach: wp.float64,  # what a link's ends may move apart in one iteration, over its length now or the mean length
    iterations: wp.int32,
    tolerance: wp.float64,  # [m]
    relative: wp.float64,  # tolerance of a length over the rest length, and of the balance over the forces
    accepted: wp.float64,  # times the tolerance: what counts as converged where iterations end above it
    # Scratch and out:
    m: Matrix,
    p: Particles,
    links: Links,
    points: Points,
    c: Touching,
    u: wp.array[Vec3],  # [particle_count] [m]
    iterations_used: wp.array[wp.int32],  # [1] of all pieces and steps of the frame
    unconverged: wp.array[wp.int32],  # [1] pieces and steps that did not reach the tolerance
    missed: wp.array[wp.int32],  # [piece_count] the same by piece
):
    """Lines 9-11; one thread a piece."""
    piece = wp.tid()
    begin = s.piece_first[piece]
    end = s.piece_first[piece + 1]
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    scale = one
    if first:
        scale = lam_scale
    soften = wp.float64(compliance_scale[0])

    for t in range(begin, end):
        i = s.particle[t]
        p.weight[t] = wp.float64(w[i])
        p.mass[t] = zero
        if p.weight[t] > zero:
            p.mass[t] = one / p.weight[t]
        p.free[t] = double(base[i])
        p.move[t] = double(u[i])
        if first and p.weight[t] > zero:
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

    mean_length = p.mean_length[piece]
    rigid = p.gives[piece] == 0
    polishing = bool(False)
    done = bool(False)
    began = int(0)
    used = int(0)
    error = zero
    gave = zero
    widest_before = zero
    touch = wp.float64(TOUCH)
    while used < iterations and not done:
        used = used + 1
        lagging = (used / LAG) % 2 == 1

        forward_pass(
            begin, end, s, m, p, links, points, c, rigid, mean_gradient, wp.float64(SHORT) * mean_length, touch, lagging
        )
        left, widest, given, switched, touches = back_pass(
            begin, end, s, m, p, links, points, c, rigid, mean_gradient, touch, lagging, mean_length,
            tolerance, relative, wp.float64(SLACK) * relative,
        )  # fmt: skip
        error = left
        gave = given
        patience = int(PATIENCE)
        if touches:
            patience = TOUCHING
        # Links that give under forces so large that rounding moves them: steps that are small and shrink no more.
        if not rigid and not touches and widest < wp.float64(STILL) and widest > wp.float64(0.25) * widest_before:
            error = wp.min(error, one)
        widest_before = widest
        if not wp.isfinite(m.b[begin]):  # the last that is found: all that is not finite arrives there
            error = wp.float64(wp.inf)
        back_off = zero
        if widest > reach:
            back_off = one - reach / widest
            error = wp.float64(wp.inf)
        for t in range(begin, end):
            p.move[t] = p.move[t] - back_off * m.b[t]
            m.b[t] = wp.vec3d()

        if lagging and switched:
            touch = wp.min(wp.float64(10.0) * touch, wp.float64(YIELDING))
        else:
            touch = wp.max(wp.float64(0.1) * touch, wp.float64(FIRMEST))
        if switched:
            error = wp.float64(wp.inf)
            if rigid:
                began = used
        if error <= one:
            if rigid:
                p.gives[piece] = 0
                done = True
            else:
                p.gives[piece] = p.gives[piece] - 1
                if not polishing and (p.gives[piece] <= 0 or gave < wp.float64(0.25) * p.strain[piece]):
                    rigid = True
                    polishing = True
                    began = used
                else:
                    if polishing:
                        p.gives[piece] = AGAIN
                        p.strain[piece] = gave
                    done = True
        elif rigid and (used - began >= patience or (polishing and used - began >= POLISH)):
            rigid = False
            p.gives[piece] = wp.max(p.gives[piece], 1)
            began = used

    if mean_gradient and not rigid:
        longest = zero
        for q in range(s.link_first[begin], s.link_first[end]):
            longest = wp.max(longest, links.fixed[q][2] / wp.max(links.fixed[q][0], wp.float64(1.0e-300)) - one)
        if longest < wp.float64(TAUT) or gave > wp.float64(2.0) * longest:
            error = wp.float64(wp.inf)
    for t in range(begin, end):
        p.shift[t] = p.move[t] - p.free[t]
        u[s.particle[t]] = Vec3(Real(p.move[t][0]), Real(p.move[t][1]), Real(p.move[t][2]))
    wp.atomic_add(iterations_used, 0, used)
    if not (error <= accepted):
        wp.atomic_add(unconverged, 0, 1)
        missed[piece] = missed[piece] + 1
