"""Contacts of links (link_contact.py) as weighted ones (weighted.py), for Newton's method.

Between two links the closest points move along both: weights, normal and gap are those of now. While they are not on
the side from which the links came, C is that of the half-space which line 8 found, with the weights found. A collider
is that half-space throughout the step.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.capsule import nearest_points
from pbd_warp.kernels.contact import friction_of
from pbd_warp.kernels.pieces import Particles
from pbd_warp.kernels.precision import Real, Vec3, Vec4, kernel
from pbd_warp.kernels.touch import double
from pbd_warp.kernels.weighted import NOBODY, Contacts, Memory, add_contact, displacement, turn_contact


@wp.struct
class LinkPairs:
    """Contacts of links among those found."""

    place: wp.array[wp.int32]  # [capacity] among the weighted contacts, -1: none of these
    side: wp.array[wp.vec3d]  # [capacity] normal where they first touch, or at the start
    share: wp.array[wp.vec4d]  # [capacity] weights there
    gap: wp.array[wp.float64]  # [capacity] at the start along `side` [m]
    rest: wp.array[wp.float64]  # [capacity] distance of the axes that is kept there [m]


@wp.func
def doubled(a: wp.vec4f):
    return wp.vec4d(wp.float64(a[0]), wp.float64(a[1]), wp.float64(a[2]), wp.float64(a[3]))


@wp.func
def doubled(a: wp.vec4d):  # noqa: F811 Warp overloads by type
    return a


@kernel
def list_links(
    # Model:
    link: wp.array[wp.vec2i],  # [link_count]
    radius: wp.array[Real],  # [particle_count] [m]
    friction: Real,
    collider_friction: wp.array[Real],  # [collider_count]
    # State:
    x: wp.array[Vec3],
    # In:
    count: wp.array[wp.int32],  # [1]
    pair: wp.array[wp.vec2i],  # [capacity]
    member: wp.array[wp.vec4i],  # [capacity]
    weight: wp.array[Vec4],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
    gap: wp.array[Real],  # [capacity]
    lam_scale: wp.float64,
    round_off: wp.float64,  # of positions, relative
    memory: Memory,
    # Out:
    pairs: LinkPairs,
    c: Contacts,
):
    k = wp.tid()
    pairs.place[k] = NOBODY
    if k >= wp.min(count[0], pair.shape[0]):
        return
    a = link[pair[k][0]]
    all = wp.vec4i(a[0], a[1], NOBODY, NOBODY)
    if pair[k][1] >= 0:
        b = link[pair[k][1]]
        all = wp.vec4i(a[0], a[1], b[0], b[1])
    # A particle by itself takes part once.
    if all[0] == all[1]:
        all[1] = NOBODY
    if all[2] == all[3]:
        all[3] = NOBODY
    share = doubled(weight[k])
    n = double(normal[k])
    away = wp.vec3d()
    thick = wp.float64(0.0)
    far = wp.float64(0.0)
    for m in range(4):
        i = member[k][m]
        if i >= 0:
            away = away + share[m] * double(x[i])
            thick = thick + wp.abs(share[m]) * wp.float64(radius[i])
            far = wp.max(far, wp.length(double(x[i])))
    pairs.side[k] = n
    pairs.share[k] = share
    pairs.gap[k] = wp.float64(gap[k])
    pairs.rest[k] = wp.dot(n, away) - wp.float64(gap[k])
    mu = wp.float64(friction_of(pair[k][1], friction, collider_friction))
    pairs.place[k] = add_contact(c, memory, all, mu, thick, round_off * far, n, lam_scale)


@kernel
def follow_links(
    # Model:
    radius: wp.array[Real],  # [particle_count] [m]
    # State:
    x: wp.array[Vec3],
    # In:
    u: wp.array[Vec3],  # of what is not solved for
    tile: wp.array[wp.int32],  # [particle_count]
    p: Particles,
    pairs: LinkPairs,
    # Out:
    c: Contacts,
):
    """Gaps, weights and normals as the particles are now."""
    k = wp.tid()
    q = pairs.place[k]
    if q < 0:
        return
    member = c.member[q]
    n = pairs.side[k]
    share = pairs.share[k]
    one = wp.float64(1.0)
    u_b = wp.vec3d()
    u_p = wp.vec3d()
    u_q = wp.vec3d()
    u_a = displacement(member[0], tile, p, double(u[member[0]]))
    if member[1] >= 0:
        u_b = displacement(member[1], tile, p, double(u[member[1]]))
    if member[2] >= 0:
        u_p = displacement(member[2], tile, p, double(u[member[2]]))
    if member[3] >= 0:
        u_q = displacement(member[3], tile, p, double(u[member[3]]))
    # As line 8 found it, until a better one is known.
    away = share[0] * u_a + share[1] * u_b + share[2] * u_p + share[3] * u_q
    C = wp.dot(n, away) + pairs.gap[k]
    if member[2] >= 0:
        start = double(x[member[0]]) - double(x[member[2]])
        d_a = wp.vec3d()
        d_b = wp.vec3d()
        r_a = wp.float64(radius[member[0]])
        r_b = wp.float64(radius[member[2]])
        grow_a = wp.float64(0.0)
        grow_b = wp.float64(0.0)
        if member[1] >= 0:
            d_a = (double(x[member[1]]) - double(x[member[0]])) + (u_b - u_a)
            grow_a = wp.float64(radius[member[1]]) - r_a
        if member[3] >= 0:
            d_b = (double(x[member[3]]) - double(x[member[2]])) + (u_q - u_p)
            grow_b = wp.float64(radius[member[3]]) - r_b
        from_b = start + (u_a - u_p)
        thick = r_a + wp.max(grow_a, wp.float64(0.0)) + r_b + wp.max(grow_b, wp.float64(0.0))
        s, t = nearest_points(from_b, d_a, d_b, thick)
        if member[1] < 0:
            s = wp.float64(0.0)
        if member[3] < 0:
            t = wp.float64(0.0)
        between = from_b + s * d_a - t * d_b
        size = wp.length(between)
        if wp.dot(n, between) > wp.float64(0.5) * size:
            n = between / size
            # What is kept beyond or short of the radii stays so.
            kept = pairs.rest[k] + (s - share[1]) * grow_a + (t + share[3]) * grow_b
            C = size - kept
            share = wp.vec4d(one - s, s, t - one, -t)
            away = share[0] * u_a + share[1] * u_b + share[2] * u_p + share[3] * u_q
    carried = wp.vec3d()
    for m in range(4):
        if member[m] >= 0:
            if tile[member[m]] < 0:
                carried = carried + share[m] * double(u[member[m]])
    turn_contact(c, q, share, n, C, away, carried)


@kernel
def note_links(
    # In:
    pairs: LinkPairs,
    c: Contacts,
    # Out, for line 16:
    lam: wp.array[Real],  # [capacity]
    member: wp.array[wp.vec4i],  # [capacity]
    weight: wp.array[Vec4],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
):
    k = wp.tid()
    q = pairs.place[k]
    if q < 0:
        return
    n = c.normal[q]
    share = c.weight[q]
    lam[k] = Real(wp.dot(c.force[q], n))
    normal[k] = Vec3(Real(n[0]), Real(n[1]), Real(n[2]))
    weight[k] = Vec4(Real(share[0]), Real(share[1]), Real(share[2]), Real(share[3]))
    taking = c.member[q]
    for m in range(4):
        if share[m] == wp.float64(0.0):
            taking[m] = NOBODY
    member[k] = taking
