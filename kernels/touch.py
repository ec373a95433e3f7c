"""Rows of Newton's matrix (newton.py) as the particles' tiles see them: points and contacts.

A row c + J du + (a + e) dlam = 0 whose particles are one particle and things that are fixed or led adds to that
particle's own tile alone: e^-1 J^T J on the matrix, J^T (lam - c / e) on the right side, where e is what it gives.

Contact with something fixed or led: gap C >= 0 along the normal n, pushed by lam >= 0, and Coulomb's law for the slip s
of the step in the tangent plane. Semi-smooth Newton (Alart and Curnier 1991; the active set of Hintermueller, Ito and
Kunisch 2002): each contact is open, or sticks (s = 0), or slides (force -mu lam t with t = s / |s|, whose normal part
stands in the same row). It opens when lam would pull and closes, sliding, when C < 0; it slides when sticking would
take more than mu lam, and sticks again when it would slide backwards. No scale compares forces with lengths for that.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.contact import friction_of
from pbd_warp.kernels.pieces import Touching
from pbd_warp.kernels.precision import Real, Vec3, kernel
from pbd_warp.kernels.shapes import SPHERE

OPEN = wp.constant(0)
STICKS = wp.constant(1)
SLIDES = wp.constant(2)

NONE = wp.constant(-1)

CURVED = wp.constant(0.2)
"""Of a particle's stiffness: the negative stiffness that the curvature of a surface may have."""


@wp.func
def double(a: wp.vec3f):
    return wp.vec3d(wp.float64(a[0]), wp.float64(a[1]), wp.float64(a[2]))


@wp.func
def double(a: wp.vec3d):  # noqa: F811 Warp overloads by type
    return a


@kernel
def forget_contacts(
    # Out:
    head: wp.array[wp.int32],  # [particle_count]
):
    head[wp.tid()] = NONE


@kernel
def list_contacts(
    # Model:
    collider_kind: wp.array[wp.int32],  # [collider_count]
    collider_centre: wp.array[Vec3],  # [collider_count]
    friction: Real,  # of particles with each other
    collider_friction: wp.array[Real],  # [collider_count]
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    count: wp.array[wp.int32],  # [1]
    pair: wp.array[wp.vec2i],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
    gap: wp.array[Real],  # [capacity]
    carried: wp.array[Vec3],  # [capacity] displacement of a collider where it is touched [m], or None: none moves
    radius: wp.array[Real],  # [particle_count]
    u: wp.array[Vec3],  # [particle_count]
    memory: wp.array[wp.vec3d],  # [particle_count * collider_count] force of the step before [kg m]
    lam_scale: wp.float64,
    round_off: wp.float64,  # of positions, relative
    # Out:
    c: Touching,
):
    """Contacts with what is fixed or led, as a list for each particle; the force of the step before is the guess."""
    k = wp.tid()
    c.status[k] = OPEN
    c.lam[k] = wp.float64(0.0)
    c.grip[k] = wp.vec3d()
    if k >= wp.min(count[0], pair.shape[0]):
        return
    i = pair[k][0]
    j = pair[k][1]
    n = double(normal[k])
    sign = wp.float64(1.0)
    if j >= 0:
        if w[i] > Real(0.0) and w[j] > Real(0.0):
            return
        if w[i] == Real(0.0):
            i = pair[k][1]
            j = pair[k][0]
            sign = wp.float64(-1.0)
    n = sign * n
    mu = wp.float64(friction_of(pair[k][1], friction, collider_friction))
    moved = wp.vec3d()
    away = wp.vec3d()
    curved = wp.float64(-1.0)
    if j >= 0:
        moved = double(u[j])
        away = double(x[i]) - double(x[j])
        curved = wp.float64(radius[i]) + wp.float64(radius[j]) - wp.float64(gap[k])
        if wp.dot(n, n) > wp.float64(0.0):
            curved = wp.dot(n, away) - wp.float64(gap[k])
    else:
        q = -1 - j
        if carried:
            moved = double(carried[k])
        if collider_kind[q] == SPHERE:
            away = double(x[i]) - double(collider_centre[q])
            curved = wp.dot(n, away) - wp.float64(gap[k])
        force = lam_scale * memory[i * collider_kind.shape[0] + q]
        push = wp.dot(n, force)
        if push > wp.float64(0.0):
            hold = force - push * n
            c.lam[k] = push
            c.grip[k] = hold
            c.status[k] = STICKS
            if wp.length(hold) >= wp.float64(0.999999) * mu * push:
                c.status[k] = SLIDES
    c.side[k] = n
    c.led[k] = moved
    c.start[k] = away - moved
    c.surface[k] = wp.vec4d(wp.float64(gap[k]), curved, mu, wp.float64(4.0) * round_off * wp.length(double(x[i])))
    c.following[k] = wp.atomic_exch(c.head, i, k)


@wp.func
def gap_now(move: wp.vec3d, side: wp.vec3d, start: wp.vec3d, led: wp.vec3d, surface: wp.vec4d):
    """C, the normal there, and the curvature of the surface. What is round stays a half-space along the normal where
    the path came in, until the particle is on that side of it."""
    c = wp.dot(side, move - led) + surface[0]
    n = side
    curvature = wp.float64(0.0)
    if surface[1] >= wp.float64(0.0):
        s = start + move
        size = wp.length(s)
        if size > wp.float64(0.0):
            if wp.dot(side, s) > wp.float64(0.5) * size or wp.dot(side, side) == wp.float64(0.0):
                c = size - surface[1]
                n = s / size
                curvature = wp.float64(1.0) / size
    return c, n, curvature


@wp.func
def contact_row(
    status: wp.int32,
    c: wp.float64,
    n: wp.vec3d,
    curvature: wp.float64,
    slip: wp.vec3d,  # tangential [m]
    lam: wp.float64,
    grip: wp.vec3d,
    mu: wp.float64,
    e: wp.float64,  # 1 / what the contact gives along the normal
    e_t: wp.float64,  # and across it
    softest: wp.float64,  # the most negative stiffness of its curvature, > 0
    lagging: wp.bool,  # friction is bounded by the push as it was, not as this step makes it
):
    """Of a contact that pushes: its block of the matrix and its force."""
    across = wp.identity(3, dtype=wp.float64) - wp.outer(n, n)
    push = lam - c * e
    M = e * wp.outer(n, n) - wp.min(wp.max(lam, wp.float64(0.0)) * curvature, softest) * across
    force = push * n
    if mu > wp.float64(0.0):
        hold = grip - wp.dot(n, grip) * n - e_t * slip
        held = wp.length(hold)
        if status == STICKS:
            M = M + e_t * across
            force = force + hold
        elif held > wp.float64(0.0):
            t = hold / held
            if lagging:
                push = lam
            else:
                M = M + (mu * e) * wp.outer(t, n)
            force = force + (mu * push) * t
            M = M + wp.min(mu * wp.max(push, wp.float64(0.0)) / held, wp.float64(1.0)) * e_t * (across - wp.outer(t, t))
    return M, force


@wp.func
def contact_step(
    status: wp.int32,
    c: wp.float64,
    n: wp.vec3d,
    curvature: wp.float64,
    gone: wp.vec3d,  # displacement over that of what is fixed or led, after the step
    du: wp.vec3d,
    lam: wp.float64,
    grip: wp.vec3d,
    mu: wp.float64,
    e: wp.float64,
    e_t: wp.float64,
    weight: wp.float64,
    softest: wp.float64,
    lagging: wp.bool,
    scale: wp.float64,
    tolerance: wp.float64,
    relative: wp.float64,
):
    """After a step: status, lam and friction, and what is left of gap and balance over what is tolerated."""
    zero = wp.float64(0.0)
    push = lam - (c + wp.dot(n, du)) * e
    tolerated = tolerance + relative * (scale + weight * wp.abs(push))
    if push <= zero:  # what it would have pulled is missing
        return OPEN, zero, wp.vec3d(), weight * (wp.length(grip) - push) / tolerated
    far = wp.length(du)
    pushed = wp.abs(push - lam)
    bent = wp.max(lam * curvature - softest, zero)
    left = wp.float64(0.5) * curvature * far * far + pushed / e + weight * (curvature * pushed + bent) * far
    now = STICKS
    hold = wp.vec3d()
    if mu > zero:
        slip = gone - wp.dot(n, gone) * n
        before = grip - wp.dot(n, grip) * n
        hold = before - e_t * slip
        if status == SLIDES:
            moved = du - wp.dot(n, du) * n
            along = before - e_t * (slip - moved)
            if wp.dot(slip, along) > zero:
                # It would slide the way it is pushed: it sticks, and friction begins with what this step had.
                size = wp.length(along)
                t = along / size
                hold = (mu * push) * (t - (e_t / size) * (moved - wp.dot(t, moved) * t))
                held = wp.length(hold)
                if held > mu * push:
                    left = left + weight * (held - mu * push)
                    hold = hold * (mu * push / held)
                left = left + wp.length(slip)
                return STICKS, push, hold, left / tolerated
        held = wp.length(hold)
        if held > mu * push:
            now = SLIDES
            hold = hold * (mu * push / held)
            if status == STICKS:
                left = left + weight * (held - mu * push)
        elif status == SLIDES:
            left = left + weight * (mu * push - held)
        # What changed, and what lies in the tangent plane of before.
        left = left + wp.length(hold - grip) / e_t + weight * curvature * wp.length(hold) * far
        if now == SLIDES:
            turn = wp.min(e_t * far / held, wp.float64(1.0))
            left = left + weight * mu * turn * (push * turn + pushed)
            if lagging:
                left = left + weight * mu * pushed
    return now, push, hold, left / tolerated


@kernel
def note_contacts(
    # In:
    count: wp.array[wp.int32],  # [1]
    pair: wp.array[wp.vec2i],  # [capacity]
    c: Touching,
    u: wp.array[Vec3],
    # Out:
    lam: wp.array[Real],  # [capacity] for line 16
    normal: wp.array[Vec3],  # [capacity] for line 16: at the middle of the way, along which a surface is followed
    colliders: wp.int32,
    memory: wp.array[wp.vec3d],  # [particle_count * colliders] zero before
):
    k = wp.tid()
    if k >= wp.min(count[0], pair.shape[0]) or c.lam[k] == wp.float64(0.0):
        return
    i = pair[k][0]
    j = pair[k][1]
    lam[k] = Real(c.lam[k])
    if j < 0:
        move = double(u[i])
        gap, n, curvature = gap_now(move, c.side[k], c.start[k], c.led[k], c.surface[k])
        memory[i * colliders - 1 - j] = memory[i * colliders - 1 - j] + c.lam[k] * n + c.grip[k]
        if curvature > wp.float64(0.0):
            n = wp.normalize(c.start[k] + wp.float64(0.5) * move)
            normal[k] = Vec3(Real(n[0]), Real(n[1]), Real(n[2]))
