"""velocityUpdate, line 16, for contacts of links: bounce.py with up to four particles a contact."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.contact import friction_of
from pbd_warp.kernels.precision import Real, Vec3, Vec4, func, kernel


@func
def change_of_impact(
    relative: Vec3,  # velocity after the projection [m/s]
    before: Vec3,  # and after line 5
    n: Vec3,
    restitution: Real,
    friction: Real,
    resting: Real,  # approach slower than this does not bounce [m/s]
):
    """By how much line 16 changes the relative velocity of a contact that pushed."""
    v_n = wp.dot(n, relative)
    approach = wp.dot(n, before)
    change = -v_n
    if -approach > resting:  # which is at least 0: what parts does not bounce
        change = -restitution * approach - v_n
    slide = relative - v_n * n
    speed = wp.length(slide)
    grip = wp.min(friction * wp.max(change, Real(0.0)), speed)
    impulse = change * n
    if grip > Real(0.0):
        impulse = impulse - slide * (grip / speed)
    return impulse


@kernel
def count_active_links(
    # In:
    count: wp.array[wp.int32],
    member: wp.array[wp.vec4i],
    lam: wp.array[Real],
    # Out:
    valence: wp.array[wp.int32],  # [particle_count] contacts that pushed, added to
):
    k = wp.tid()
    if k < count[0] and lam[k] > Real(0.0):
        taking = member[k]
        for m in range(4):
            if taking[m] >= 0:
                wp.atomic_add(valence, taking[m], 1)


@kernel
def bounce_links(
    # Model:
    friction: Real,  # of links with each other
    restitution: Real,
    collider_friction: wp.array[Real],  # [collider_count]
    collider_restitution: wp.array[Real],
    resting: Real,  # approach slower than this does not bounce [m/s]
    # State:
    v: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    member: wp.array[wp.vec4i],
    weight: wp.array[Vec4],
    normal: wp.array[Vec3],
    lam: wp.array[Real],
    v_before: wp.array[Vec3],  # [particle_count] after line 5 [m/s]
    valence: wp.array[wp.int32],  # [particle_count] contacts that pushed
    # Out:
    dv: wp.array[Vec3],  # [particle_count] added to [m/s]
):
    k = wp.tid()
    if k >= count[0] or lam[k] <= Real(0.0):
        return
    taking = member[k]
    share = weight[k]
    inverse_mass = Real(0.0)
    relative = Vec3()
    before = Vec3()
    for m in range(4):
        i = taking[m]
        if i >= 0:
            relative = relative + share[m] * v[i]
            before = before + share[m] * v_before[i]
            inverse_mass = inverse_mass + Real(valence[i]) * w[i] * share[m] * share[m]
    e = restitution
    j = pair[k][1]
    if j < 0:
        e = collider_restitution[-1 - j]
    mu = friction_of(j, friction, collider_friction)
    impulse = change_of_impact(relative, before, normal[k], e, mu, resting) / inverse_mass
    for m in range(4):
        i = taking[m]
        if i >= 0:
            wp.atomic_add(dv, i, (w[i] * share[m]) * impulse)
