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

The gradient g is that of C at the end of the step ("pbd", "bdf2"), g = d / |d|, or a discrete one between start and end
("midpoint"), g = (d_0 + d_1) / (|d_0| + |d_1|), for which work is exactly the change of potential energy. Both give
K = kappa (1 - g n^T) with n = d_1 / |d_1| and kappa = -lam / |d_1| or -lam / (|d_0| + |d_1|).
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.elimination import back, divide_tile, factor_tile, forward, forward_tile
from pbd_warp.kernels.precision import Real, Vec3, kernel

PATIENCE = wp.constant(10)
"""Iterations in which rigid links converge, or the piece is taken for one that has to give."""

POLISH = wp.constant(3)
"""Iterations in which rigid links converge from where elastic ones did, if they ever do."""


@wp.func
def double(a: wp.vec3f):
    return wp.vec3d(wp.float64(a[0]), wp.float64(a[1]), wp.float64(a[2]))


@wp.func
def double(a: wp.vec3d):  # noqa: F811 Warp overloads by type
    return a


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
    reach: wp.array[wp.float64],  # [piece_count] what a link's ends may move apart in one iteration [m]
    point_first: wp.array[wp.int32],  # [tile_count + 1], or None: no points
    target: wp.array[Vec3],  # [point_count] [m]
    point: wp.array[wp.int32],  # [points with a tile] which, tile by tile
    point_compliance: wp.array[Real],  # [point_count] [m/N], or None: all 0
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    per_force: wp.array[Real],  # [1] 1 / the integrator's force scale [1/s^2]
    mean_gradient: wp.bool,  # force along the mean of the configurations before and after the step
    lam_scale: wp.float64,  # takes forces of the step before to this step's scale
    iterations: wp.int32,
    tolerance: wp.float64,  # [m]
    relative: wp.float64,  # tolerance of a length over the rest length, and of the balance over the forces
    accepted: wp.float64,  # times the tolerance: what counts as converged where iterations end above it
    # Scratch:
    where: wp.array[wp.int32],  # [tile_count]
    D: wp.array[wp.mat33d],  # [tile_count] diagonal, zero between steps
    b: wp.array[wp.vec3d],  # [tile_count] right side, then du
    F: wp.array[wp.mat33d],  # [tile_count] factors of the diagonal
    low: wp.array[wp.mat33d],  # [slot_count] below the diagonal
    up: wp.array[wp.mat33d],  # [slot_count] above it
    weight: wp.array[wp.float64],  # [tile_count] inverse mass, 0: held
    free: wp.array[wp.vec3d],  # [tile_count] displacement without constraints
    move: wp.array[wp.vec3d],  # [tile_count] u
    start: wp.array[wp.vec3d],  # [link_count] d_0
    fixed: wp.array[wp.vec4d],  # [link_count] rest length, a, |d_0|, w_i + w_j
    normal: wp.array[wp.vec3d],  # [link_count] n
    rest: wp.array[wp.vec4d],  # [link_count] c, 1 / (a + e), turning, what kappa was cut by
    # Out:
    lam: wp.array[wp.float64],  # [link_count] [kg m]; starts as that of the step before
    point_lam: wp.array[wp.vec3d],  # [point_count]
    shift: wp.array[wp.vec3d],  # [tile_count] what constraints moved in the step before, and now [m]
    gives: wp.array[wp.int32],  # [piece_count] 1: its links had to give in the step before, and now
    u: wp.array[Vec3],  # [particle_count] [m]
    iterations_used: wp.array[wp.int32],  # [1] of all pieces and steps of the frame
    unconverged: wp.array[wp.int32],  # [1] pieces and steps that did not reach the tolerance
):
    """Lines 9-11; one thread a piece."""
    piece = wp.tid()
    begin = piece_first[piece]
    end = piece_first[piece + 1]
    zero = wp.float64(0.0)
    half = wp.float64(0.5)
    one = wp.float64(1.0)
    tiny = wp.float64(1.0e-300)
    identity = wp.identity(3, dtype=wp.float64)
    soften = wp.float64(per_force[0])

    for t in range(begin, end):
        i = particle[t]
        weight[t] = wp.float64(w[i])
        free[t] = double(u[i])
        move[t] = free[t]
        if weight[t] > zero:
            move[t] = free[t] + lam_scale * shift[t]
    for t in range(begin, end):
        i = particle[t]
        for q in range(link_first[t], link_first[t + 1]):
            j = partner[q]
            d = double(x[i]) - double(x[j])
            away = wp.float64(w[j])
            if other[q] < 0:
                d = d - double(u[j])
                away = zero
            a = zero
            if compliance:
                a = wp.float64(compliance[q]) * soften
            before = zero
            if mean_gradient:
                d0 = d
                if other[q] < 0:
                    d0 = d + double(u[j])
                before = wp.length(d0)
            start[q] = d
            fixed[q] = wp.vec4d(wp.float64(rest_length[q]), a, before, weight[t] + away)
            lam[q] = lam[q] * lam_scale
        if point_first:
            for q in range(point_first[t], point_first[t + 1]):
                point_lam[point[q]] = point_lam[point[q]] * lam_scale

    rigid = gives[piece] == 0
    phase_began = int(0)
    polishing = bool(False)
    done = bool(False)
    used = int(0)
    error = zero
    while used < iterations and not done:
        used = used + 1

        # Forward: the links that a tile brings in, what is eliminated before it, its own factors.
        for t in range(begin, end):
            held = weight[t] == zero
            for s in range(column_first[t], column_first[t + 1]):
                low[s] = wp.mat33d()
                up[s] = wp.mat33d()
                where[row[s]] = s
            A = D[t]
            z = b[t]
            if not held:
                inertia = one / weight[t]
                A = A + inertia * identity
                z = z - inertia * (move[t] - free[t])
            for q in range(link_first[t], link_first[t + 1]):
                r = other[q]
                d = start[q] + move[t]
                if r >= 0:
                    d = d - move[r]
                f = fixed[q]
                L = f[0]
                pull = lam[q]
                length = wp.length(d)
                n = wp.vec3d(one, zero, zero)
                if length > zero:
                    n = d / length
                g = n
                size = wp.max(length, half * L)
                turning = one / wp.max(size, tiny)
                kappa = -pull * turning
                c = length - L
                a = f[1]
                if mean_gradient:
                    before = f[2]
                    both = one / wp.max(length + before, tiny)
                    s0 = start[q]
                    if r < 0:
                        s0 = s0 + double(u[partner[q]])
                    g = (s0 + d) * both
                    kappa = -pull * both
                    if a > zero:
                        c = c + (before - L)
                        a = a + a
                cut = zero
                if kappa < softest[q]:
                    cut = softest[q] - kappa
                    kappa = softest[q]
                if not rigid:
                    a = a + elastic[q]
                c = c + a * pull
                e = one / wp.max(a, proximal[q])
                normal[q] = n
                rest[q] = wp.vec4d(c, e, turning, cut)
                M = kappa * identity + (e - kappa) * wp.outer(g, n)
                force = (pull - c * e) * g
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
                if point_first:
                    for q in range(point_first[t], point_first[t + 1]):
                        k = point[q]
                        a = zero
                        if point_compliance:
                            a = wp.float64(point_compliance[k]) * soften
                        gone = double(x[particle[t]]) - double(target[k])
                        c3 = gone + move[t]
                        if mean_gradient and a > zero:
                            c3 = c3 + gone
                            a = a + a
                        e = one / wp.max(a, wp.float64(1.0e-12) * weight[t])
                        A = A + e * identity
                        z = z + point_lam[k] - e * (c3 + a * point_lam[k])
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
                factors = factor_tile(A)
                F[t] = factors
                b[t] = forward(factors, z)
                for s in range(column_first[t], column_first[t + 1]):
                    low[s] = divide_tile(low[s], factors)
                    up[s] = forward_tile(factors, up[s])

        # Back. What is left after a Newton step is of second order in it, so the step itself tells.
        error = zero
        widest = zero
        for o in range(end - begin):
            t = end - 1 - o
            z = b[t]
            for s in range(column_first[t], column_first[t + 1]):
                z = z - up[s] * b[row[s]]
            du = back(F[t], z)
            b[t] = du
            move[t] = move[t] + du
            for q in range(link_first[t], link_first[t + 1]):
                r = other[q]
                apart = du
                if r >= 0:
                    apart = apart - b[r]
                f = fixed[q]
                if f[3] > zero:
                    now = rest[q]
                    dlam = -(now[0] + wp.dot(normal[q], apart)) * now[1]
                    far = wp.length(apart)
                    turn = far * now[2]
                    pull = wp.abs(lam[q])
                    pulled = wp.abs(dlam)
                    left = half * far * turn
                    a = f[1]
                    if mean_gradient:
                        a = a + a
                    if not rigid:
                        a = a + elastic[q]
                    left = left + wp.max(one / now[1] - a, zero) * pulled
                    error = wp.max(error, left / (tolerance + relative * f[0]))
                    left = f[3] * (turn * (pulled + turn * pull) + now[3] * far)
                    error = wp.max(error, left / (tolerance + relative * (f[0] + f[3] * pull)))
                    widest = wp.max(widest, far)
                    lam[q] = lam[q] + dlam
            if point_first:
                if weight[t] > zero:
                    for q in range(point_first[t], point_first[t + 1]):
                        k = point[q]
                        a = zero
                        if point_compliance:
                            a = wp.float64(point_compliance[k]) * soften
                        gone = double(x[particle[t]]) - double(target[k])
                        c3 = gone + (move[t] - du)
                        if mean_gradient and a > zero:
                            c3 = c3 + gone
                            a = a + a
                        e = one / wp.max(a, wp.float64(1.0e-12) * weight[t])
                        change = -e * (c3 + du + a * point_lam[k])
                        point_lam[k] = point_lam[k] + change
        for t in range(begin, end):
            if widest > reach[piece]:
                move[t] = move[t] - (one - reach[piece] / widest) * b[t]
            b[t] = wp.vec3d()
        if widest > reach[piece]:
            error = wp.max(error, accepted + one)

        since = used - phase_began
        if error <= one:
            if rigid:
                gives[piece] = 0
                done = True
            elif polishing or used == iterations:
                gives[piece] = 1
                done = True
            else:
                rigid = True
                polishing = True
                phase_began = used
        elif rigid:
            if (polishing and since >= POLISH) or since >= PATIENCE:
                rigid = False
                polishing = since < PATIENCE
                phase_began = used

    for t in range(begin, end):
        shift[t] = move[t] - free[t]
        u[particle[t]] = Vec3(Real(move[t][0]), Real(move[t][1]), Real(move[t][2]))
    wp.atomic_add(iterations_used, 0, used)
    if not (error <= one or (done or error <= accepted)):
        wp.atomic_add(unconverged, 0, 1)
