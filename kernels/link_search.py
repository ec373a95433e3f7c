"""Line 8 for links: which of them come near each other on the way x -> x + u, as contacts of link_contact.py."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.capsule import meet
from pbd_warp.kernels.contact import joined, limit_overlap
from pbd_warp.kernels.link_sides import keep_side
from pbd_warp.kernels.precision import Real, Vec3, Vec4, func, kernel

NONE = wp.constant(-1)


@kernel
def sweep_links(
    # Model:
    link: wp.array[wp.vec2i],  # [link_count]
    radius: wp.array[Real],  # [particle_count] [m]
    margin: Real,  # watched beyond touching, relative to the radii
    # State:
    x: wp.array[Vec3],
    # In:
    u: wp.array[Vec3],
    # Out:
    middle: wp.array[Vec3],  # [link_count] of the box below [m]
    extent: wp.array[Real],  # [link_count] radius of the ball around it that holds the link all along the step [m]
    half_box: wp.array[Vec3],  # [link_count] of the box that does [m]
):
    e = wp.tid()
    i = link[e][0]
    j = link[e][1]
    low = wp.min(wp.min(x[i], x[j]), wp.min(x[i] + u[i], x[j] + u[j]))
    high = wp.max(wp.max(x[i], x[j]), wp.max(x[i] + u[i], x[j] + u[j]))
    thick = (Real(1.0) + margin) * wp.max(radius[i], radius[j])
    m = Real(0.5) * (low + high)
    middle[e] = m
    half_box[e] = Real(0.5) * (high - low) + Vec3(thick, thick, thick)
    far = wp.max(wp.length(x[i] - m), wp.length(x[j] - m))
    extent[e] = thick + wp.max(far, wp.max(wp.length(x[i] + u[i] - m), wp.length(x[j] + u[j] - m)))


@func
def check_links(
    a: wp.int32,
    b: wp.int32,
    # Model:
    link: wp.array[wp.vec2i],
    radius: wp.array[Real],
    margin: Real,
    depenetration: Real,
    neighbour_start: wp.array[wp.int32],
    neighbour: wp.array[wp.int32],
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    table: wp.array[wp.int32],
    pair_before: wp.array[wp.vec2i],
    normal_before: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    member: wp.array[wp.vec4i],
    weight: wp.array[Vec4],
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    valence: wp.array[wp.int32],
):
    """Notes two links, a < b, as a contact where they come close; arguments as below."""
    if joined(neighbour_start, neighbour, a, b):
        return
    i = link[a][0]
    j = link[a][1]
    p = link[b][0]
    q = link[b][1]
    if w[i] + w[j] + w[p] + w[q] == Real(0.0):
        return
    apart = x[i] - x[p]
    d_a = x[j] - x[i]
    d_b = x[q] - x[p]
    near, s, t, n = meet(
        apart,
        d_a,
        d_b,
        u[i] - u[p],
        u[j] - u[i],
        u[q] - u[p],
        radius[i],
        radius[j],
        radius[p],
        radius[q],
    )
    rest = radius[i] + s * (radius[j] - radius[i]) + radius[p] + t * (radius[q] - radius[p])
    if near >= margin * rest:
        return
    if i == j:
        s = Real(0.0)  # one particle, which takes part once
    if p == q:
        t = Real(0.0)
    n = keep_side(n, wp.vec2i(a, b), table, pair_before, normal_before)
    share = Vec4(Real(1.0) - s, s, t - Real(1.0), -t)
    taking = wp.vec4i(i, j, p, q)
    k = wp.atomic_add(count, 0, 1)
    if k < pair.shape[0]:
        for m in range(4):
            if share[m] == Real(0.0):
                taking[m] = NONE
            else:
                wp.atomic_add(valence, taking[m], 1)
        pair[k] = wp.vec2i(a, b)
        member[k] = taking
        weight[k] = share
        normal[k] = n
        gap[k] = limit_overlap(wp.dot(n, apart + s * d_a - t * d_b) - rest, depenetration)


@kernel
def find_link_contacts(
    # Model:
    grid: wp.uint64,  # HashGrid over the middles
    link: wp.array[wp.vec2i],  # [link_count] both ends, twice the same for a particle by itself
    radius: wp.array[Real],  # [particle_count] [m]
    margin: Real,  # watched beyond touching, relative to the sum of radii
    depenetration: Real,  # overlap that a step takes back at most [m]; negative: all of it
    neighbour_start: wp.array[wp.int32],  # [link_count + 1]
    neighbour: wp.array[wp.int32],  # of each link those that it need not be kept off
    last: wp.array[wp.int32],  # [link_count] behind the last link of the same copy of a replicated model
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    table: wp.array[wp.int32],
    pair_before: wp.array[wp.vec2i],
    normal_before: wp.array[Vec3],
    middle: wp.array[Vec3],
    extent: wp.array[Real],
    half_box: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],  # [1] contacts found, may exceed the capacity
    pair: wp.array[wp.vec2i],  # [capacity] links, the lower one first
    member: wp.array[wp.vec4i],  # [capacity]
    weight: wp.array[Vec4],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
    gap: wp.array[Real],  # [capacity] [m]
    valence: wp.array[wp.int32],  # [particle_count]
):
    """Line 8: links whose paths x -> x + u come within a margin of touching, each pair once. The one whose ball is
    larger looks for the other, so its own size bounds the search, and a fast or long one widens nobody else's."""
    e = wp.hash_grid_point_id(grid, wp.tid())
    size = extent[e]
    m = middle[e]
    box = half_box[e]
    for f in wp.hash_grid_query(grid, m, size + size):
        if size > extent[f] or (size == extent[f] and e < f):
            away = wp.abs(middle[f] - m) - (box + half_box[f])
            if wp.max(wp.max(away[0], away[1]), away[2]) <= Real(0.0) and last[e] == last[f]:
                check_links(
                    wp.min(e, f),
                    wp.max(e, f),
                    link,
                    radius,
                    margin,
                    depenetration,
                    neighbour_start,
                    neighbour,
                    x,
                    w,
                    u,
                    table,
                    pair_before,
                    normal_before,
                    count,
                    pair,
                    member,
                    weight,
                    normal,
                    gap,
                    valence,
                )


@kernel
def find_close_link_contacts(
    # Model:
    link: wp.array[wp.vec2i],
    radius: wp.array[Real],
    margin: Real,
    depenetration: Real,
    neighbour_start: wp.array[wp.int32],
    neighbour: wp.array[wp.int32],
    last: wp.array[wp.int32],
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    table: wp.array[wp.int32],
    pair_before: wp.array[wp.vec2i],
    normal_before: wp.array[Vec3],
    middle: wp.array[Vec3],
    half_box: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    member: wp.array[wp.vec4i],
    weight: wp.array[Vec4],
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    valence: wp.array[wp.int32],
):
    """Line 8 for few links: as `find_link_contacts`, but each looks at all of its copy that come after it."""
    e = wp.tid()
    m = middle[e]
    box = half_box[e]
    for f in range(e + 1, last[e]):
        away = wp.abs(middle[f] - m) - (box + half_box[f])
        if wp.max(wp.max(away[0], away[1]), away[2]) <= Real(0.0):
            check_links(
                e,
                f,
                link,
                radius,
                margin,
                depenetration,
                neighbour_start,
                neighbour,
                x,
                w,
                u,
                table,
                pair_before,
                normal_before,
                count,
                pair,
                member,
                weight,
                normal,
                gap,
                valence,
            )
