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

from pbd_warp.kernels.elimination import back, divide_tile, factor_tile, forward, forward_tile, pivot
from pbd_warp.kernels.link_row import SHORT, link_row, link_step, point_now, point_row
from pbd_warp.kernels.precision import Real, Vec3, kernel
from pbd_warp.kernels.rows import OPEN, SLIDES, STICKS, contact_row, contact_step, double, gap_now

PATIENCE = wp.constant(10)
"""Iterations in which rigid links converge, or the piece is taken for one that has to give."""

TOUCHING = wp.constant(40)
"""The same of pieces that touch something."""

POLISH = wp.constant(3)
"""Iterations in which rigid links converge from where elastic ones did, if they ever do."""

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

CURVED = wp.constant(0.2)
"""Of a particle's inertia: the negative stiffness that the curvature of a surface may have."""


@kernel
def solve_pieces(
    # Schedule (methods/schedule.py):
    piece_first: wp.array[wp.int32],  # [piece_count + 1]
    particle: wp.array[wp.int32],  # [tile_count]
    column_first: wp.array[wp.int32],  # [tile_count + 1]
    row: wp.array[wp.int32],  # [slot_count]
    row_first: wp.array[wp.int32],  # [tile_count + 1]
    row_slot: wp.array[wp.int32],  # [slot_count]
    row_column: wp.array[wp.int32],  # [slot_count]
    link_first: wp.array[wp.int32],  # [tile_count + 1]
    other: wp.array[wp.int32],  # [link_count] tile at the other end, -1: fixed
    partner: wp.array[wp.int32],  # [link_count] particle at the other end
    slot: wp.array[wp.int32],  # [link_count] of the tile where both ends meet, -1: none
    # Model:
    rest_length: wp.array[Real],  # [link_count] [m]
    compliance: wp.array[Real],  # [link_count] [m/N], or None: all 0
    proximal: wp.array[wp.float64],  # [link_count] e in the matrix alone [1/kg]
    elastic: wp.array[wp.float64],  # [link_count] e of links that have to give [1/kg]
    softest: wp.array[wp.float64],  # [link_count] the most negative kappa [kg]
    give: wp.array[wp.float64],  # [tile_count] e of the rows of one particle [1/kg]
    mean_length: wp.array[wp.float64],  # [piece_count] of its links [m]
    reach: wp.float64,  # what a link's ends may move apart in one iteration, over its length now or the mean length
    point_first: wp.array[wp.int32],  # [tile_count + 1], or None: no points
    point: wp.array[wp.int32],  # [points with a tile] which, tile by tile
    target: wp.array[Vec3],  # [point_count] [m]
    point_compliance: wp.array[Real],  # [point_count] [m/N], or None: all 0
    # Contacts with what is fixed or led (rows.py), or None:
    head: wp.array[wp.int32],  # [particle_count]
    following: wp.array[wp.int32],  # [capacity]
    side: wp.array[wp.vec3d],  # [capacity]
    contact_start: wp.array[wp.vec3d],  # [capacity]
    led: wp.array[wp.vec3d],  # [capacity]
    surface: wp.array[wp.vec4d],  # [capacity]
    contact_lam: wp.array[wp.float64],  # [capacity]
    grip: wp.array[wp.vec3d],  # [capacity]
    status: wp.array[wp.int32],  # [capacity]
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    base: wp.array[Vec3],  # [particle_count] displacement without constraints [m]
    per_force: wp.array[Real],  # [1] 1 / the integrator's force scale [1/s^2]
    mean_gradient: wp.bool,  # force along the mean of the configurations before and after the step
    first: wp.bool,  # in the step: multipliers and u are guesses from the one before, otherwise those of now
    lam_scale: wp.float64,  # takes forces of the step before to this step's scale
    iterations: wp.int32,
    tolerance: wp.float64,  # [m]
    relative: wp.float64,  # tolerance of a length over the rest length, and of the balance over the forces
    accepted: wp.float64,  # times the tolerance: what counts as converged where iterations end above it
    round_off: wp.float64,  # of positions, relative
    # Scratch:
    where: wp.array[wp.int32],  # [tile_count]
    D: wp.array[wp.mat33d],  # [tile_count] diagonal, zero between steps
    b: wp.array[wp.vec3d],  # [tile_count] right side, then du; zero between steps
    F: wp.array[wp.mat33d],  # [tile_count] factors of the diagonal
    low: wp.array[wp.mat33d],  # [slot_count] below the diagonal
    up: wp.array[wp.mat33d],  # [slot_count] above it
    weight: wp.array[wp.float64],  # [tile_count] inverse mass, 0: held
    free: wp.array[wp.vec3d],  # [tile_count] displacement without constraints
    move: wp.array[wp.vec3d],  # [tile_count] u
    start: wp.array[wp.vec3d],  # [link_count] d_0, less the displacement of an end that is fixed
    before: wp.array[wp.vec3d],  # [link_count] d_0
    fixed: wp.array[wp.vec4d],  # [link_count] rest length, a, |d_0|, w_i + w_j
    normal: wp.array[wp.vec3d],  # [link_count] n
    rest: wp.array[wp.vec4d],  # [link_count] from link_row to link_step
    # Out:
    lam: wp.array[wp.float64],  # [link_count] [kg m]; starts as that of the step before
    vector_lam: wp.array[wp.vec3d],  # [link_count] of links without length, or None: there are none
    point_lam: wp.array[wp.vec3d],  # [point_count]
    shift: wp.array[wp.vec3d],  # [tile_count] what constraints moved in the step before, and now [m]
    gives: wp.array[wp.int32],  # [piece_count] steps until links that had to give are tried as rigid ones
    strain: wp.array[wp.float64],  # [piece_count] how far they gave
    u: wp.array[Vec3],  # [particle_count] [m]
    iterations_used: wp.array[wp.int32],  # [1] of all pieces and steps of the frame
    unconverged: wp.array[wp.int32],  # [1] pieces and steps that did not reach the tolerance
):
    """Lines 9-11; one thread a piece."""
    piece = wp.tid()
    begin = piece_first[piece]
    end = piece_first[piece + 1]
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    never = wp.float64(wp.inf)
    identity = wp.identity(3, dtype=wp.float64)
    soften = wp.float64(per_force[0])
    short = wp.float64(SHORT) * mean_length[piece]

    scale_now = one
    if first:
        scale_now = lam_scale

    for t in range(begin, end):
        i = particle[t]
        weight[t] = wp.float64(w[i])
        free[t] = double(base[i])
        move[t] = double(u[i])
        if first and weight[t] > zero:
            move[t] = free[t] + scale_now * shift[t]
    for t in range(begin, end):
        i = particle[t]
        for q in range(link_first[t], link_first[t + 1]):
            j = partner[q]
            d = double(x[i]) - double(x[j])
            before[q] = d
            start[q] = d
            mobility = weight[t] + wp.float64(w[j])
            if other[q] < 0:
                start[q] = d - double(u[j])
                mobility = weight[t]
            soft = zero
            if compliance:
                soft = wp.float64(compliance[q]) * soften
            fixed[q] = wp.vec4d(wp.float64(rest_length[q]), soft, wp.length(d), mobility)
            lam[q] = lam[q] * scale_now
            if vector_lam:
                vector_lam[q] = vector_lam[q] * scale_now
        if point_first:
            for q in range(point_first[t], point_first[t + 1]):
                point_lam[point[q]] = point_lam[point[q]] * scale_now

    rigid = gives[piece] == 0
    polishing = bool(False)
    began = int(0)
    used = int(0)
    done = bool(False)
    error = zero
    touch = wp.float64(TOUCH)
    while used < iterations and not done:
        used = used + 1
        lagging = (used / LAG) % 2 == 1
        # Forward: the links that a tile brings in, what is eliminated before it, its own factors.
        for t in range(begin, end):
            held = weight[t] == zero
            for s in range(column_first[t], column_first[t + 1]):
                low[s] = wp.mat33d()
                up[s] = wp.mat33d()
                where[row[s]] = s
            A = D[t]
            z = b[t]
            for q in range(link_first[t], link_first[t + 1]):
                r = other[q]
                d = start[q] + move[t]
                if r >= 0:
                    d = d - move[r]
                f = fixed[q]
                yields = zero
                steadies = proximal[q]
                if not rigid:
                    yields = elastic[q]
                    steadies = zero
                if f[0] > zero:
                    M, force, n, step = link_row(
                        d, before[q], f[0], f[1], f[2], lam[q], steadies, yields, softest[q], short, mean_gradient
                    )
                    normal[q] = n
                    rest[q] = step
                else:
                    away = d
                    soft = f[1] + yields
                    if mean_gradient and f[1] > zero:
                        away = away + before[q]
                        soft = soft + f[1]
                    e, pull = point_row(away, vector_lam[q], soft, steadies)
                    M = e * identity
                    force = pull
                A = A + M
                z = z + force
                if r >= 0:
                    D[r] = D[r] + M
                    b[r] = b[r] - force
                    if not held and weight[r] > zero:
                        k = slot[q]
                        low[k] = low[k] - M
                        up[k] = up[k] - M
            D[t] = wp.mat33d()
            if held:
                b[t] = wp.vec3d()
                F[t] = wp.mat33d()
            else:
                inertia = one / weight[t]
                A = A + inertia * identity
                z = z - inertia * (move[t] - free[t])
                if point_first:
                    for q in range(point_first[t], point_first[t + 1]):
                        k = point[q]
                        gone = double(x[particle[t]]) - double(target[k])
                        away, soft = point_now(gone, move[t], k, point_compliance, soften, mean_gradient)
                        if not rigid:
                            soft = soft + give[t]
                        e, pull = point_row(away, point_lam[k], soft, give[t])
                        A = A + e * identity
                        z = z + pull
                slides = bool(False)
                if head:
                    k = head[particle[t]]
                    while k >= 0:
                        gap, outward, curvature = gap_now(move[t], side[k], contact_start[k], led[k], surface[k])
                        if status[k] == OPEN and gap < zero:
                            status[k] = SLIDES
                        if status[k] != OPEN:
                            slip = move[t] - led[k]
                            slip = slip - wp.dot(outward, slip) * outward
                            M, force = contact_row(
                                status[k], gap, outward, curvature, slip, contact_lam[k], grip[k],
                                surface[k][2], inertia / touch, wp.float64(CURVED) * inertia, lagging,
                            )  # fmt: skip
                            A = A + M
                            z = z + force
                            slides = slides or status[k] == SLIDES
                        k = following[k]
                for q in range(row_first[t], row_first[t + 1]):
                    s = row_slot[q]
                    m = row_column[q]
                    X = low[s]
                    Y = up[s]
                    A = A - X * Y
                    z = z - X * b[m]
                    for k in range(s + 1, column_first[m + 1]):
                        to = where[row[k]]
                        low[to] = low[to] - low[k] * Y
                        up[to] = up[to] - X * up[k]
                if slides:
                    P = pivot(A)
                    A = P * A
                    z = P * z
                    for s in range(column_first[t], column_first[t + 1]):
                        up[s] = P * up[s]
                factors = factor_tile(A)
                F[t] = factors
                b[t] = forward(factors, z)
                for s in range(column_first[t], column_first[t + 1]):
                    low[s] = divide_tile(low[s], factors)
                    up[s] = forward_tile(factors, up[s])

        # Back, and what the step leaves.
        error = zero
        widest = zero
        gave = zero
        switched = bool(False)
        patience = int(PATIENCE)
        for o in range(end - begin):
            t = end - 1 - o
            z = b[t]
            for s in range(column_first[t], column_first[t + 1]):
                z = z - up[s] * b[row[s]]
            du = back(F[t], z)
            b[t] = du
            moved = move[t] + du
            move[t] = moved
            for q in range(link_first[t], link_first[t + 1]):
                r = other[q]
                apart = du
                d = start[q] + moved
                if r >= 0:
                    apart = apart - b[r]
                    d = d - move[r]
                f = fixed[q]
                yields = zero
                steadies = proximal[q]
                if not rigid:
                    yields = elastic[q]
                    steadies = zero
                if f[0] == zero:
                    away = d
                    soft = f[1] + yields
                    if mean_gradient and f[1] > zero:
                        away = away + before[q]
                        soft = soft + f[1]
                    e, pull = point_row(away, vector_lam[q], soft, steadies)
                    left = wp.max(one / e - soft, zero) * wp.length(pull - vector_lam[q])
                    error = wp.max(error, left / (tolerance + relative * mean_length[piece]))
                    vector_lam[q] = pull
                elif f[3] > zero:
                    pulls, left = link_step(
                        apart, d, normal[q], rest[q], f, lam[q], yields, mean_gradient, tolerance, relative
                    )
                    lam[q] = pulls
                    error = wp.max(error, left)
                    widest = wp.max(widest, wp.length(apart) / wp.max(one / rest[q][2], mean_length[piece]))
                    gave = wp.max(gave, yields * wp.abs(pulls) / f[0])
            if weight[t] > zero:
                if point_first:
                    for q in range(point_first[t], point_first[t + 1]):
                        k = point[q]
                        gone = double(x[particle[t]]) - double(target[k])
                        away, soft = point_now(gone, moved, k, point_compliance, soften, mean_gradient)
                        if not rigid:
                            soft = soft + give[t]
                        e, pull = point_row(away, point_lam[k], soft, give[t])
                        point_lam[k] = pull
                if head:
                    scale = wp.max(mean_length[piece], wp.length(free[t]))
                    rounding = wp.float64(4.0) * round_off * wp.length(double(x[particle[t]]))
                    k = head[particle[t]]
                    while k >= 0:
                        if status[k] == OPEN:
                            gap, outward, curvature = gap_now(moved, side[k], contact_start[k], led[k], surface[k])
                            switched = switched or gap < -(tolerance + rounding + wp.float64(SLACK) * relative * scale)
                        else:
                            gap, outward, curvature = gap_now(moved - du, side[k], contact_start[k], led[k], surface[k])
                            now, push, hold, left = contact_step(
                                status[k], gap, outward, curvature, moved - led[k], du, contact_lam[k], grip[k],
                                surface[k][2], one / (touch * weight[t]), weight[t], wp.float64(CURVED), scale, tolerance + rounding,
                                wp.float64(SLACK) * relative,
                            )  # fmt: skip
                            switched = switched or (now != status[k] and left > one)
                            patience = TOUCHING
                            status[k] = now
                            contact_lam[k] = push
                            grip[k] = hold
                            error = wp.max(error, left)
                        k = following[k]
        back_off = zero
        if widest > reach:
            back_off = one - reach / widest
            error = never
        for t in range(begin, end):
            move[t] = move[t] - back_off * b[t]
            b[t] = wp.vec3d()

        if lagging and switched:
            touch = wp.min(wp.float64(10.0) * touch, wp.float64(YIELDING))
        else:
            touch = wp.max(wp.float64(0.1) * touch, wp.float64(FIRMEST))
        if switched:
            error = never
            if rigid:
                began = used
        if error <= one:
            if rigid:
                gives[piece] = 0
                done = True
            else:
                gives[piece] = gives[piece] - 1
                if not polishing and (gives[piece] <= 0 or gave < wp.float64(0.25) * strain[piece]):
                    rigid = True
                    polishing = True
                    began = used
                else:
                    if polishing:
                        gives[piece] = AGAIN
                        strain[piece] = gave
                    done = True
        elif rigid and used - began >= patience or polishing and used - began >= POLISH:
            rigid = False
            gives[piece] = wp.max(gives[piece], 1)
            began = used

    for t in range(begin, end):
        shift[t] = move[t] - free[t]
        u[particle[t]] = Vec3(Real(move[t][0]), Real(move[t][1]), Real(move[t][2]))
    wp.atomic_add(iterations_used, 0, used)
    if not (error <= accepted):
        wp.atomic_add(unconverged, 0, 1)
