"""All distance constraints of a path at once: Newton's method, each step an elimination along the path.

With r the residual of the momentum balance and c that of the constraints,

    r_i = (u_i - b_i) / w_i - sum_k s_ik g_k lam_k        s_ik = +1 / -1 for the first / second end of link k
    c_k = C_k + a_k lam_k

one step solves, link by link, for du (three unknowns a particle) and dlam (one a link)

    [ 1/w + K   -G ] [ du   ]     [ r ]
    [ J          a ] [ dlam ] = - [ c ]

b is the displacement without constraints, a the compliance over the integrator's force scale. The geometric stiffness
K_k = -lam_k dg_k/dd belongs to the turning of links under tension; with it the method converges where projection along
present gradients does not (1000 links, 4 substeps), and what it converges to balances momentum exactly, so that
"midpoint" keeps energy. Of a link that pushes (lam > 0) K is negative: no more of it counts than leaves the matrix
positive, so convergence is quadratic for ropes that are pushed together by little in a step, and linear beyond.
Source: ours; elimination as in Thomas's algorithm for tridiagonal systems, with blocks (dlam_k, du_k+1).

The gradient g is that of C at the end of the step ("pbd", "bdf2"), g = d / |d|, or a discrete one between start and end
("midpoint"), g = (d_0 + d_1) / (|d_0| + |d_1|), for which work is exactly the change of potential energy. Both give
K = kappa (1 - g n^T) with n = d_1 / |d_1| and kappa = -lam / |d_1| or -lam / (|d_0| + |d_1|).

Fails when: no configuration satisfies the constraints (a rope held at both ends further apart than its length).
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.distance import distance_over_step
from pbd_warp.kernels.precision import Mat33, Real, Vec3, kernel

SOFTEST = wp.constant(0.2)
"""How much of a particle's inertia the negative stiffness of a link that pushes may take away. Tried on straight ropes
that are pushed together: 0 converges linearly, often too slowly; from 0.3 on it finds solutions of far more energy."""


@wp.func
def is_locked(s: wp.int32, point: wp.array[wp.int32], point_compliance: wp.array[Any]):
    """Whether a rigid point constraint says where the particle at place s of the paths goes."""
    if point:
        if point[s] >= 0:
            if point_compliance:
                return point_compliance[point[s]] == point_compliance.dtype(0.0)
            return True
    return False


@kernel
def solve_paths(
    # Model:
    first: wp.array[wp.int32],  # [path_count + 1] where each path begins in `vertex`
    vertex: wp.array[wp.int32],  # [path particles] particles along the paths, one path after the other
    rest_length: wp.array[Real],  # [path particles] of the link to the next one (of the last: unused)
    compliance: wp.array[Real],  # [path particles] of the link to the next one [m/N], or None: all 0
    point: wp.array[wp.int32],  # [path particles] index of a point constraint, -1 for none; or None: no points
    target: wp.array[Vec3],  # [point_count] [m]
    point_compliance: wp.array[Real],  # [point_count] [m/N], or None: all 0
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    base: wp.array[Vec3],  # [particle_count] displacement without constraints [m]
    per_force: wp.array[Real],  # [1] 1 / the integrator's force scale [1/s^2]
    mean_gradient: wp.bool,  # force along the mean of the configurations before and after the step
    lam_scale: Real,  # takes lam of the step before to this step's force scale
    iterations: wp.int32,
    tolerance: Real,  # [m]
    accepted: Real,  # an error that counts as converged where the iterations end above the tolerance [m]
    round_off: Real,  # of one operation, relative
    # Scratch, all [path particles]:
    inverse: wp.array[Mat33],
    solution: wp.array[Vec3],
    gradient: wp.array[Vec3],
    normal: wp.array[Vec3],
    kappa: wp.array[Real],
    lam_gain: wp.array[Vec3],
    lam_solution: wp.array[Real],
    # Out:
    lam: wp.array[Real],  # [path particles] of the link to the next one; starts as that of the step before
    u: wp.array[Vec3],  # [particle_count] [m]
    iterations_used: wp.array[wp.int32],  # [1] of all paths and steps of the frame
    unconverged: wp.array[wp.int32],  # [1] paths and steps that did not reach the tolerance
):
    """Lines 9-11 for distances and the points on their paths; one thread a path."""
    p = wp.tid()
    begin = first[p]
    end = first[p + 1]
    one = wp.identity(3, dtype=Real)
    zero = Real(0.0)
    for s in range(begin, end):
        lam[s] = lam[s] * lam_scale
        if is_locked(s, point, point_compliance) and w[vertex[s]] > zero:
            u[vertex[s]] = target[point[s]] - x[vertex[s]]

    used = int(0)
    error = Real(tolerance + Real(1.0))
    step_before = Real(0.0)
    while used < iterations and error > tolerance:
        used = used + 1

        # Forward. Of the link behind the particle: g, n, k, a, c; of the particle behind: P = S^-1, m = S^-1 b.
        P = Mat33()
        m = Vec3()
        g = Vec3()
        n = Vec3()
        k = Real(0.0)
        a = Real(0.0)
        c = Real(0.0)
        force = Vec3()
        left_out = Real(0.0)
        for s in range(begin, end):
            i = vertex[s]
            Pg = P * g
            nP = wp.transpose(P) * n
            nPg = wp.dot(n, Pg)
            A = k * (one - wp.outer(g, n)) - (k * k) * (P - wp.outer(g, nP) - wp.outer(Pg, n) + nPg * wp.outer(g, n))
            b = k * (m - wp.dot(n, m) * g) - force
            turned = g - k * (Pg - nPg * g)
            q = n - k * (nP - wp.dot(g, nP) * n)
            e = nPg + a
            rhs = c - wp.dot(n, m)

            g = Vec3()
            n = Vec3()
            k = Real(0.0)
            a = Real(0.0)
            c = Real(0.0)
            force = Vec3()
            if s + 1 < end:
                j = vertex[s + 1]
                soft = zero
                if compliance:
                    soft = compliance[s] * per_force[0]
                stretch, n_s, g_s, size, a_s = distance_over_step(
                    x[i] - x[j], u[i] - u[j], rest_length[s], soft, mean_gradient
                )
                n = n_s
                g = g_s
                a = a_s
                c = -(stretch + a * lam[s])
                if size > zero:
                    k = -lam[s] / size
                    if k < zero:
                        k = wp.max(k, -Real(SOFTEST) / wp.max(w[i], w[j]))
                force = lam[s] * g
            gradient[s] = g
            normal[s] = n
            kappa[s] = k

            P = Mat33()
            m = Vec3()
            gain = Vec3()
            known = Real(0.0)
            w_i = w[i]
            if w_i == zero or is_locked(s, point, point_compliance):
                if e > zero:
                    known = rhs / e
            else:
                A = A + (one / w_i + k * (one - wp.outer(g, n)))
                b = b - ((u[i] - base[i]) / w_i - force)
                if point:
                    if point[s] >= 0:
                        spring = Real(1.0) / (point_compliance[point[s]] * per_force[0])
                        away = x[i] - target[point[s]] + u[i]
                        if mean_gradient:
                            spring = Real(0.5) * spring
                            away = away + (x[i] - target[point[s]])
                        b = b - spring * away
                        A = A + spring * one
                P = wp.inverse(A)
                m = P * b
                t = P * turned
                z = wp.transpose(P) * q
                pivot = e + wp.dot(q, t)
                if pivot > zero:
                    gain = z / pivot
                    known = rhs / pivot + wp.dot(gain, b)
                    m = m - known * t
                    P = P - wp.outer(t, gain)
                else:
                    left_out = wp.max(left_out, wp.abs(rhs))
            inverse[s] = P
            solution[s] = m
            lam_gain[s] = gain
            lam_solution[s] = known

        # Back. What is left after a Newton step is of second order in it, so the step itself tells.
        error = Real(0.0)
        step = Real(0.0)
        largest = Real(0.0)
        du = Vec3()
        dlam = Real(0.0)
        weight = Real(0.0)
        for r in range(end - begin):
            s = end - 1 - r
            i = vertex[s]
            g = gradient[s]
            n = normal[s]
            k = kappa[s]
            pull = k * (du - wp.dot(n, du) * g) + dlam * g
            change = solution[s] + inverse[s] * pull
            if r > 0:
                turn = wp.length(change - du)
                error = wp.max(
                    error, turn * (turn + (wp.abs(dlam) + wp.abs(lam[s])) * (w[i] + weight)) / rest_length[s]
                )
            weight = w[i]
            du = change
            dlam = lam_solution[s] + wp.dot(lam_gain[s], pull)
            u[i] = u[i] + du
            step = wp.max(step, wp.length(du))
            largest = wp.max(largest, wp.length(u[i]))
            if s > begin:
                lam[s - 1] = lam[s - 1] + dlam
        # Quadratic convergence ends where rounding, which adds up along the path, makes the step.
        if step <= round_off * Real(end - begin) * largest and step > Real(0.25) * step_before:
            error = Real(0.0)
        step_before = step
        # A link whose pivot vanishes takes no part in this step: its error is what it is, whatever the others' steps.
        error = wp.max(error, left_out)
    wp.atomic_add(iterations_used, 0, used)
    if not (error <= accepted):
        wp.atomic_add(unconverged, 0, 1)


@kernel
def add_corrections_to_both(
    # Out:
    correction: wp.array[Vec3],  # [particle_count] taken and set to zero
    base: wp.array[Vec3],  # [particle_count] added to
    u: wp.array[Vec3],  # [particle_count] added to
):
    """What contacts do between two solutions: it moves the particles, and is no force of the paths."""
    i = wp.tid()
    base[i] = base[i] + correction[i]
    u[i] = u[i] + correction[i]
    correction[i] = Vec3()
