"""A triangle mesh, in a wp.Mesh; its size is (1 where it is closed and 0 where it is open, the depth of its deepest
place where it is closed, its reach from the origin) [m].

A closed mesh is solid, with its free side where its triangles are seen counterclockwise. An open one is a sheet, and
holds on both sides: the normal points to the side where one is.

Warp finds the nearest triangle, in float32; the nearest point of that triangle is worked out in the precision of the
step, so a step is no coarser than its other constraints. Inside of a triangle the normal is the triangle's own, which
rounding cannot turn however near one is; at edges and corners it points from them.
The side at edges and corners, where the nearest triangle's plane does not tell it, is that of the triangle which a ray
from s into that triangle meets first. (Warp's own sign sums up all normals at the same distance, which is nonsense in
the middle of a torus.)
Source: nearest point of a triangle after Ericson 2005, Real-Time Collision Detection, section 5.1.5; the ray is ours.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func

INTO = wp.constant(1.0e-2)
"""Of the way from an edge to the middle of its triangle, where a ray meets it."""


@func
def corner(mesh: wp.uint64, number: wp.int32):
    """A corner of a triangle."""
    p = wp.mesh_get_point(mesh, number)
    return Vec3(Real(p[0]), Real(p[1]), Real(p[2]))


@func
def nearest_on_triangle(a: Vec3, b: Vec3, c: Vec3, s: Vec3):
    """The nearest point to s as barycentric weights (of a, b, c)."""
    zero = Real(0.0)
    one = Real(1.0)
    ab = b - a
    ac = c - a
    d1 = wp.dot(ab, s - a)
    d2 = wp.dot(ac, s - a)
    if d1 <= zero and d2 <= zero:
        return Vec3(one, zero, zero)
    d3 = wp.dot(ab, s - b)
    d4 = wp.dot(ac, s - b)
    if d3 >= zero and d4 <= d3:
        return Vec3(zero, one, zero)
    of_c = d1 * d4 - d3 * d2
    if of_c <= zero and d1 >= zero and d3 <= zero:
        t = d1 / (d1 - d3)
        return Vec3(one - t, t, zero)
    d5 = wp.dot(ab, s - c)
    d6 = wp.dot(ac, s - c)
    if d6 >= zero and d5 <= d6:
        return Vec3(zero, zero, one)
    of_b = d5 * d2 - d1 * d6
    if of_b <= zero and d2 >= zero and d6 <= zero:
        t = d2 / (d2 - d6)
        return Vec3(one - t, zero, t)
    of_a = d3 * d6 - d5 * d4
    if of_a <= zero and d4 - d3 >= zero and d5 - d6 >= zero:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return Vec3(zero, one - t, t)
    total = of_a + of_b + of_c
    return Vec3(of_a / total, of_b / total, of_c / total)


@func
def behind(id: wp.uint64, point: wp.vec3f, a: Vec3, b: Vec3, c: Vec3, q: Vec3, d: Real):
    """Whether a point is inside of a closed mesh, its nearest one being q, on the edge of a triangle, d above its
    plane."""
    within = q + Real(INTO) * ((a + b + c) / Real(3.0) - q)
    to = wp.vec3f(wp.float32(within[0]), wp.float32(within[1]), wp.float32(within[2])) - point
    query = wp.mesh_query_ray(id, point, wp.normalize(to), wp.float32(2.0) * wp.length(to))
    if query.result:
        return wp.dot(query.normal, to) > wp.float32(0.0)
    return d < Real(0.0)


@func
def mesh(size: Vec3, id: wp.uint64, reach: Real, s: Vec3):
    """Distance of s [m], and the normal there; where nothing is within `reach`, that and no normal."""
    zero = Real(0.0)
    point = wp.vec3f(wp.float32(s[0]), wp.float32(s[1]), wp.float32(s[2]))
    closed = size[0] > zero
    query = wp.mesh_query_point_no_sign(id, point, wp.float32(reach))
    if not query.result and closed and wp.length(s) < size[2]:
        query = wp.mesh_query_point_no_sign(id, point, wp.float32(size[1]))  # it may be deep inside
    if not query.result:
        return reach, Vec3()
    a = corner(id, 3 * query.face)
    b = corner(id, 3 * query.face + 1)
    c = corner(id, 3 * query.face + 2)
    weight = nearest_on_triangle(a, b, c, s)
    facing = wp.normalize(wp.cross(b - a, c - a))
    away = s - (weight[0] * a + weight[1] * b + weight[2] * c)
    d = wp.dot(facing, s - a)
    n = facing
    if wp.min(weight) > zero:
        if not closed and d < zero:
            return -d, -n
        return d, n
    apart = wp.length(away)
    if apart > Real(1.0e-6) * wp.length(b - a):
        if closed and behind(id, point, a, b, c, s - away, d):
            return -apart, -away / apart
        return apart, away / apart
    return d, n
