"""Contacts of up to four particles on two sides, as Newton's method sees them from iteration to iteration.

A contact of particles m with weights a_m, positive on the first side and negative on the second:

    away = sum_m a_m u_m        C = gap + n . away >= 0        slip = away - (n . away) n

Whoever finds contacts (pairs.py) lists them once a step and follows them from iteration to iteration: C along the
normal n as both are now. The force f = push n + friction acts on the first side with a_m f on each particle, on the
second with the opposite; it turns with the normal.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.pieces import Particles
from pbd_warp.kernels.precision import kernel

NOBODY = wp.constant(-1)


@wp.struct
class Contacts:
    """Of one step."""

    count: wp.array[wp.int32]  # [1] wanted, may exceed the capacity
    member: wp.array[wp.vec4i]  # [capacity] particles, -1: none
    weight: wp.array[wp.vec4d]  # [capacity]
    normal: wp.array[wp.vec3d]  # [capacity] unit, from the second to the first side
    gap: wp.array[wp.float64]  # [capacity] [m]
    friction: wp.array[wp.float64]  # [capacity] Coulomb's coefficient
    size: wp.array[wp.float64]  # [capacity] lengths from which C is the difference [m]
    rounding: wp.array[wp.float64]  # [capacity] of the positions from which C comes [m]
    carried: wp.array[wp.vec3d]  # [capacity] share in `away` of members that are not solved for [m]
    force: wp.array[wp.vec3d]  # [capacity] on the first side [kg m]
    turned: wp.array[wp.float64]  # [capacity] by how much force turned with the normal [kg m]
    # Scratch of the sweeps (coupled.py):
    port: wp.array[wp.vec4i]  # [capacity] of the members, -1: not solved for
    response: wp.array[wp.mat33d]  # [capacity] the contact's own block of W [1/kg]
    before: wp.array[wp.vec3d]  # [capacity] force before the sweeps
    change: wp.array[wp.vec3d]  # [capacity] of the force, in the last sweep
    way: wp.array[wp.vec3d]  # [capacity] of conjugate gradients


@wp.struct
class Memory:
    """Forces of the step before, for the first guess: a list for each first member."""

    head: wp.array[wp.int32]  # [particle_count]
    following: wp.array[wp.int32]  # [capacity]
    member: wp.array[wp.vec4i]  # [capacity]
    force: wp.array[wp.vec3d]  # [capacity] [kg m]


@kernel
def forget_forces(
    # Out:
    memory: Memory,
):
    memory.head[wp.tid()] = NOBODY


@kernel
def remember_forces(
    # In:
    c: Contacts,
    # Out:
    memory: Memory,
):
    k = wp.tid()
    if k >= wp.min(c.count[0], c.member.shape[0]) or wp.length(c.force[k]) == wp.float64(0.0):
        return
    memory.member[k] = c.member[k]
    memory.force[k] = c.force[k]
    memory.following[k] = wp.atomic_exch(memory.head, c.member[k][0], k)


@wp.func
def add_contact(
    c: Contacts,
    memory: Memory,
    member: wp.vec4i,
    friction: wp.float64,
    size: wp.float64,
    rounding: wp.float64,
    n: wp.vec3d,
    lam_scale: wp.float64,
):
    """A new contact, with the force that the same members had in the step before; its place, -1: no room."""
    k = wp.atomic_add(c.count, 0, 1)
    if k >= c.member.shape[0]:
        return NOBODY
    c.member[k] = member
    c.friction[k] = friction
    c.size[k] = size
    c.rounding[k] = rounding
    c.normal[k] = n
    c.force[k] = wp.vec3d()
    old = memory.head[member[0]]
    while old >= 0:
        if memory.member[old] == member:
            push = wp.dot(n, memory.force[old])
            if push > wp.float64(0.0):
                c.force[k] = lam_scale * memory.force[old]
            old = NOBODY
        else:
            old = memory.following[old]
    return k


@wp.func
def displacement(i: wp.int32, tile: wp.array[wp.int32], p: Particles, u: wp.vec3d):
    """Of particle i now; u: its displacement if it is not solved for."""
    t = tile[i]
    if t >= 0:
        return p.move[t]
    return u


@wp.func
def turn_contact(
    c: Contacts,
    k: wp.int32,
    weight: wp.vec4d,
    n: wp.vec3d,
    C: wp.float64,
    away: wp.vec3d,
    carried: wp.vec3d,
):
    """Contact k as it is now: C and away with the displacements of now; its force turns from the old normal to n."""
    force = c.force[k]
    push = wp.dot(force, c.normal[k])
    hold = force - push * c.normal[k]
    held = wp.length(hold)
    hold = hold - wp.dot(hold, n) * n
    size = wp.length(hold)
    if size > wp.float64(0.0):
        hold = (wp.min(held, c.friction[k] * push) / size) * hold
    now = push * n + hold
    c.turned[k] = wp.length(now - force)
    c.force[k] = now
    c.weight[k] = weight
    c.normal[k] = n
    c.gap[k] = C - wp.dot(n, away)
    c.carried[k] = carried
