"""Shapes that particles and links stay outside of: the distance to each, and the normal there, one file a shape.

A shape lies in its own frame, whose origin and axes move with it, and has three numbers, its `size`; what they mean its
file says. A new one is a file, a number here and a line in `surface`.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func
from pbd_warp.kernels.shapes.box import box
from pbd_warp.kernels.shapes.capsule import capsule
from pbd_warp.kernels.shapes.cone import cone
from pbd_warp.kernels.shapes.mesh import mesh
from pbd_warp.kernels.shapes.plane import plane
from pbd_warp.kernels.shapes.sphere import sphere

PLANE = wp.constant(0)
SPHERE = wp.constant(1)
BOX = wp.constant(2)
CAPSULE = wp.constant(3)
CONE = wp.constant(4)
MESH = wp.constant(5)
KINDS = 6


@func
def surface(kind: wp.int32, size: Vec3, id: wp.uint64, reach: Real, s: Vec3):
    """Distance of a place s [m] in the shape's frame, negative inside, and the normal there, which points out of it.

    Args:
        id: Of the wp.Mesh, for meshes.
        reach: Beyond it no one need know [m]: meshes then say `reach` and have no normal.
    """
    if kind == PLANE:
        return plane(size, s)
    if kind == SPHERE:
        return sphere(size, s)
    if kind == BOX:
        return box(size, s)
    if kind == CAPSULE:
        return capsule(size, s)
    if kind == CONE:
        return cone(size, s)
    return mesh(size, id, reach, s)


MOST_ADVANCES = wp.constant(8)
"""After so many it runs along the surface, and has as good as come in."""

CLOSE = wp.constant(0.05)
"""Of radius and way: so near it has come in."""


@func
def entry(kind: wp.int32, size: Vec3, id: wp.uint64, radius: Real, reach: Real, start: Vec3, move: Vec3):
    """Where a ball on its way start -> start + move comes in to the shape: the nearest point of the surface there, and
    the normal. Where it does not come in, those at the end of the way; where it begins inside and goes on inwards, it
    has come in at its start. No normal: it does not come within `reach` of it.

    Along a line the distance of a convex shape is convex, so Newton's method never goes too far; of others nothing is
    nearer than the distance (conservative advancement, Mirtich 1996).
    """
    zero = Real(0.0)
    far = wp.length(move)
    within = radius + reach + far
    d, n = surface(kind, size, id, within, start)
    if d >= within:
        return start, Vec3()
    at = start
    slope = wp.dot(n, move)
    close = Real(CLOSE) * (radius + far)
    if d - radius <= close and slope < zero:
        return start - d * n, n
    if kind == MESH and d > zero and d <= radius:
        radius = wp.min(radius, Real(0.5) * d)  # touching a face, it may leave through another one
    if d > radius and d - radius < far:
        gone = zero
        left = int(MOST_ADVANCES)
        while left > 0:
            left = left - 1
            if kind == MESH:
                gone = gone + (d - radius) / far
            elif slope < zero:
                gone = gone + (d - radius) / -slope
            else:
                gone = Real(1.0)
            if gone >= Real(1.0):
                left = -1
            else:
                at = start + gone * move
                d, n = surface(kind, size, id, within, at)
                slope = wp.dot(n, move)
                if d - radius <= close:
                    left = 0
        if left == 0:
            return at - d * n, n
    at = start + move
    d, n = surface(kind, size, id, within, at)
    return at - d * n, n
