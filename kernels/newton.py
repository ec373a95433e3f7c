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
from pbd_warp.kernels.bending_row import begin_bends, bending_steps, stiffen
from pbd_warp.kernels.eliminate import eliminate_piece
from pbd_warp.kernels.link_row import SHORT
from pbd_warp.kernels.pieces import Bends, Links, Matrix, Particles, Points, Schedule, Touching
from pbd_warp.kernels.precision import Real, Vec3, kernel
from pbd_warp.kernels.progress import LAG, begin_piece, end_piece, find_stiffness, first_progress, judge_piece


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
    lam_scale: wp.float64,  # takes forces of the step before, which are the first guess, to this step's scale
    reach: wp.float64,  # what a link's ends may move apart in one iteration, over its length now or the mean length
    iterations: wp.int32,
    tolerance: wp.float64,  # [m]
    relative: wp.float64,  # tolerance of a length over the rest length, and of the balance over the forces
    close: wp.float64,  # the same of gap and slip of a contact over what they come from, and of its force
    accepted: wp.float64,  # times the tolerance: what counts as converged where iterations end above it
    accepted_contact: wp.float64,  # the same of contacts
    coupled: wp.array[wp.int32],  # [piece_count] 1: not here but in coupled.py; or None: all are solved here
    # Scratch and out:
    m: Matrix,
    p: Particles,
    links: Links,
    points: Points,
    c: Touching,
    bends: Bends,
    u: wp.array[Vec3],  # [particle_count] [m]
    iterations_used: wp.array[wp.int32],  # [1] of all pieces and steps of the frame
    unconverged: wp.array[wp.int32],  # [1] pieces and steps that did not reach the tolerance
):
    """Lines 9-11; one thread a piece."""
    piece = wp.tid()
    begin = s.piece_first[piece]
    end = s.piece_first[piece + 1]
    if coupled:
        if coupled[piece] == 1:
            return
    begin_piece(
        piece, s, rest_length, compliance, target, point_compliance, x, w, base,
        wp.float64(compliance_scale[0]), mean_gradient, lam_scale, p, links, points, u,
    )  # fmt: skip
    if bends.first:
        begin_bends(piece, bends, x, u, wp.float64(compliance_scale[0]))
    mean_length = p.mean_length[piece]
    short = wp.float64(SHORT) * mean_length
    g = first_progress(p.gives[piece] == 0)
    while g.used < iterations and not g.done:
        g.used = g.used + 1
        if c.head:
            find_stiffness(begin, end, s, p, links)
            if bends.first:
                stiffen(piece, p, bends)
        lagging = (g.used / LAG) % 2 == 1
        eliminate_piece(
            piece, begin, end, s, m, p, links, points, c, bends, g.rigid, mean_gradient, short, g.touch, lagging
        )
        left, contact, widest, given, switched, touches = back_pass(
            begin, end, s, m, p, links, points, c, g.rigid, mean_gradient, g.touch, lagging, mean_length,
            tolerance, relative, close,
        )  # fmt: skip
        if bends.first:
            left = wp.max(left, bending_steps(piece, m, p, bends, tolerance, relative))
            touches = touches or bends.exact[piece] == 0  # linear convergence, which takes as long
        g = judge_piece(g, piece, begin, end, m, p, reach, lagging, left, contact, widest, given, switched, touches)
    end_piece(
        g, piece, begin, end, s, p, links, mean_gradient, accepted, accepted_contact, u, iterations_used, unconverged
    )
