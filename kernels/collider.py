"""Contacts of particles with planes and spheres at rest; all else is in shape_contact.py.

C(p) = (p - q) . n - r >= 0 with q the entry point and n the surface normal there where the path x -> p comes
in from outside, and the point of the surface closest to p where it does not.
Source: Mueller et al. 2007, section 3.4. Both kinds become half-space contacts of contact.py:
C = n . u + gap with gap = n . (x - q) - r.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.contact import limit_overlap
from pbd_warp.kernels.precision import Real, Vec3, step_pass
from pbd_warp.kernels.shapes import SPHERE


@wp.func
def sphere_normal(start: Any, move: Any, rest: Any):
    """Normal of the sphere |s| = rest at the entry point of the path start -> start + move; where the path does not
    come in, at the point closest to its end. A path that starts inside and goes on inwards has come in at its
    start: a particle at rest on the sphere and then hit hard must not leave on the other side.
    The centre itself goes out along x."""
    zero = type(rest)(0.0)
    one = type(rest)(1.0)
    a = wp.dot(move, move)
    b = wp.dot(start, move)
    c = wp.dot(start, start) - rest * rest
    discriminant = b * b - a * c
    touch = one
    if b < zero and discriminant > zero:
        # The smaller root, without cancellation; negative inside.
        touch = wp.clamp(c / (wp.sqrt(discriminant) - b), zero, one)
    point = start + touch * move
    direction = wp.vector(one, zero, zero)
    if wp.length(point) > zero:
        direction = wp.normalize(point)
    return direction


@step_pass
def find_collider_contacts(
    i: wp.int32,
    # Model:
    number: wp.array[wp.int32],  # [collider_count] among all colliders
    kind: wp.array[wp.int32],  # [collider_count] PLANE or SPHERE
    centre: wp.array[Vec3],  # [collider_count] a point of the plane, the sphere's centre [m]
    plane_normal: wp.array[Vec3],  # [collider_count] of unit length, points outside
    size: wp.array[Real],  # [collider_count] the sphere's radius [m]
    radius: wp.array[Real],  # [particle_count] [m]
    margin: Real,  # watched beyond touching, relative to r_i
    depenetration: Real,  # overlap that a step takes back at most [m]; negative: all of it
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],  # (i, -1 - collider)
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    valence: wp.array[wp.int32],
):
    """Line 8 for colliders. Watched from one step's travel away, since corrections move particles too."""
    if w[i] == Real(0.0):
        return
    reach = margin * radius[i] + wp.length(u[i])
    for c in range(kind.shape[0]):
        start = x[i] - centre[c]
        n = plane_normal[c]
        g = wp.dot(n, start) - radius[i]
        if kind[c] == SPHERE:
            rest = size[c] + radius[i]
            n = sphere_normal(start, u[i], rest)
            g = wp.dot(n, start) - rest
        if wp.min(g, g + wp.dot(n, u[i])) < reach:
            k = wp.atomic_add(count, 0, 1)
            if k < pair.shape[0]:
                pair[k] = wp.vec2i(i, -1 - number[c])
                normal[k] = n
                gap[k] = limit_overlap(g, depenetration)
                wp.atomic_add(valence, i, 1)
