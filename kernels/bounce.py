"""velocityUpdate: restitution and friction of every contact that pushed in this step.

    normal:     n . v  ->  max(-e n . v_before, 0), by an impulse j
    tangential: v_t    ->  v_t - v_t/|v_t| min(mu |j| (w_i + w_j), |v_t|) where j pushes
Source: Mueller et al. 2007, line 16; the normal part from Mueller et al. 2020, Detailed Rigid Body Simulation with
Extended Position Based Dynamics, section 3.6 (velocities before the solve).
For two particles this is the exact law of impact, v1' = ((m1 - e m2) v1 + (1 + e) m2 v2) / (m1 + m2). The projection
stops the approach, with friction for that part (contact.py); the friction here belongs to the bounce.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.contact import friction_of
from pbd_warp.kernels.precision import Real, Vec3, index, step_pass


@step_pass
def count_active(
    k: wp.int32,
    # In:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    lam: wp.array[Real],
    # Out:
    valence: wp.array[wp.int32],  # [particle_count] contacts that pushed, zero before
):
    if k < count[0] and lam[k] > Real(0.0):
        wp.atomic_add(valence, pair[k][0], 1)
        if pair[k][1] >= 0:
            wp.atomic_add(valence, pair[k][1], 1)


@step_pass
def bounce(
    k: wp.int32,
    # Model:
    friction: Real,  # of particles with each other
    restitution: Real,
    collider_friction: wp.array[Real],  # [collider_count]
    collider_restitution: wp.array[Real],
    resting: Real,  # approach slower than this does not bounce [m/s]
    dt: Real,  # of the step [s]
    # State:
    x: wp.array[Vec3],
    v: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    normal: wp.array[Vec3],
    carried: wp.array[Vec3],  # [capacity] displacement of a collider where it is touched [m], or None: none moves
    lam: wp.array[Real],
    v_before: wp.array[Vec3],  # [particle_count] after line 5 [m/s]
    valence: wp.array[wp.int32],  # [particle_count] contacts that pushed
    # Out:
    dv: wp.array[Vec3],  # [particle_count] added to [m/s]
):
    """Line 16. A particle's mass is split over its contacts, as in the projection, so momentum is kept."""
    if k >= count[0] or lam[k] <= Real(0.0):
        return
    i = index(pair[k][0])
    j = pair[k][1]
    e = restitution
    w_i = w[i]
    w_j = Real(0.0)
    weight = Real(valence[i]) * w_i
    relative = v[i]
    before = v_before[i]
    n = normal[k]
    if j >= 0:
        w_j = w[j]
        weight = weight + Real(valence[j]) * w_j
        relative = relative - v[j]
        before = before - v_before[j]
        if wp.dot(n, n) == Real(0.0):
            n = wp.normalize(x[i] - x[j])
    else:
        e = collider_restitution[-1 - j]
        if carried:
            relative = relative - carried[k] / dt
            before = before - carried[k] / dt
    v_n = wp.dot(n, relative)
    approach = wp.dot(n, before)
    if -approach <= resting:  # which is at least 0: so does nothing that parts
        e = Real(0.0)
    change = -e * approach - v_n
    slide = relative - v_n * n
    speed = wp.length(slide)
    grip = wp.min(friction_of(j, friction, collider_friction) * wp.max(change, Real(0.0)), speed)
    impulse = n * change
    if grip > Real(0.0):
        impulse = impulse - slide * (grip / speed)
    impulse = impulse / weight
    wp.atomic_add(dv, i, w_i * impulse)
    if j >= 0:
        wp.atomic_sub(dv, j, w_j * impulse)
