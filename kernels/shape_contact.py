"""Contacts of particles with any shape, at rest or moving: C(u) = n . (u - m) + gap, gap = n . (x - q) - r.

q is the point of the surface where the path comes in, seen from the shape, or the one closest to its end (shapes/); m
is what the shape's motion in the step moves q by, so u - m is the slip. Velocity and spin are constant in the step,
m = dt v + (exp(dt spin) - 1)(q - centre): a difference of two places would lose it in float32, as x + dt v does.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.contact import limit_overlap
from pbd_warp.kernels.precision import Quat, Real, Vec3, func, kernel, step_pass
from pbd_warp.kernels.shapes import MESH, entry, surface

NOOKS = wp.constant(3)
"""Contacts that a particle may have with a mesh: more faces do not keep it from going anywhere."""

ALIKE = wp.constant(0.95)
"""Two faces are one, for a particle between them, where the cosine of their normals is above this."""


@func
def turned(angle: Vec3, a: Vec3):
    """What a turn by a rotation vector [rad] adds to a vector: (exp(angle) - 1) a."""
    size = wp.length(angle)
    if size == Real(0.0):
        return Vec3()
    half = wp.sin(Real(0.5) * size) / size
    across = wp.cross(angle, a)
    return (wp.sin(size) / size) * across + (Real(2.0) * half * half) * wp.cross(angle, across)


@step_pass
def find_shape_contacts(
    i: wp.int32,
    # Model:
    number: wp.array[wp.int32],  # [shape_count] among all colliders
    kind: wp.array[wp.int32],  # [shape_count] of shapes/
    size: wp.array[Vec3],  # [shape_count]
    mesh: wp.array[wp.uint64],  # [shape_count] of those that are meshes
    radius: wp.array[Real],  # [particle_count] [m]
    margin: Real,  # watched beyond touching, relative to r_i
    depenetration: Real,  # overlap that a step takes back at most [m]; negative: all of it
    dt: Real,  # of the step [s]
    # State:
    centre: wp.array[Vec3],  # [shape_count] at the start of the step [m]
    rotation: wp.array[Quat],  # [shape_count]
    velocity: wp.array[Vec3],  # [shape_count] [m/s]
    spin: wp.array[Vec3],  # [shape_count] [rad/s]
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],  # (i, -1 - collider)
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    carried: wp.array[Vec3],  # [capacity] m [m], or None: nothing moves
    valence: wp.array[wp.int32],
):
    """Line 8 for shapes. Watched from one step's travel away, since corrections move particles too."""
    if w[i] == Real(0.0):
        return
    r = radius[i]
    for c in range(number.shape[0]):
        away = x[i] - centre[c]
        angle = dt * spin[c]
        way = u[i] - dt * velocity[c] - turned(angle, away)
        start = wp.quat_rotate_inv(rotation[c], away)
        move = wp.quat_rotate_inv(rotation[c], way + turned(-angle, way))
        reach = margin * r + wp.length(move)
        at, n = entry(kind[c], size[c], mesh[c], r, reach, start, move)
        left = int(1)
        if kind[c] == MESH:
            left = NOOKS
        if wp.dot(n, n) == Real(0.0):
            left = 0
        while left > 0:
            left = left - 1
            side = wp.quat_rotate(rotation[c], n)
            side = side + turned(angle, side)
            arm = wp.quat_rotate(rotation[c], at)
            moved = dt * velocity[c] + turned(angle, arm)
            g = wp.dot(side, away - arm) - r
            if wp.min(g, g + wp.dot(side, u[i] - moved)) < reach:
                k = wp.atomic_add(count, 0, 1)
                if k < pair.shape[0]:
                    pair[k] = wp.vec2i(i, -1 - number[c])
                    normal[k] = side
                    gap[k] = limit_overlap(g, depenetration)
                    if carried:
                        carried[k] = moved
                    wp.atomic_add(valence, i, 1)
            if left > 0:
                # Where it would be without going through this face: in a nook there is another one.
                end = start + move
                end = end - wp.min(wp.dot(n, end - at) - r, Real(0.0)) * n
                d, other = surface(kind[c], size[c], mesh[c], r + reach, end)
                at = end - d * other
                if size[c][0] == Real(0.0) and wp.dot(other, start - at) < Real(0.0):
                    other = -other  # it has gone through a sheet, whose side is that from where it came
                if wp.length(other) == Real(0.0) or wp.dot(other, n) > Real(ALIKE):
                    left = 0
                n = other


@step_pass
def move_shapes(
    c: wp.int32,
    # In:
    dt: Real,  # of the step [s]
    velocity: wp.array[Vec3],  # [shape_count] [m/s]
    spin: wp.array[Vec3],  # [shape_count] [rad/s]
    # Out:
    centre: wp.array[Vec3],  # [shape_count] [m]
    rotation: wp.array[Quat],  # [shape_count]
):
    """To where they are at the end of the step."""
    centre[c] = centre[c] + dt * velocity[c]
    angle = wp.length(spin[c])
    if angle > Real(0.0):
        rotation[c] = wp.normalize(wp.quat_from_axis_angle(spin[c] / angle, dt * angle) * rotation[c])


@step_pass
def find_overlaps(
    i: wp.int32,
    # Model:
    kind: wp.array[wp.int32],  # [shape_count]
    size: wp.array[Vec3],
    mesh: wp.array[wp.uint64],
    radius: wp.array[Real],  # [particle_count] [m]
    reach: Real,  # deeper than this no one is sought in meshes [m]
    # State:
    centre: wp.array[Vec3],
    rotation: wp.array[Quat],
    x: wp.array[Vec3],
    # Out:
    depth: wp.array[Real],  # [particle_count] of the shape that it is deepest in, 0: none [m]
    which: wp.array[wp.int32],  # [particle_count] that shape
):
    """How deep particles are in shapes; for figures between frames."""
    depth[i] = Real(0.0)
    for c in range(kind.shape[0]):
        s = wp.quat_rotate_inv(rotation[c], x[i] - centre[c])
        d, n = surface(kind[c], size[c], mesh[c], reach + radius[i], s)
        if radius[i] - d > depth[i]:
            depth[i] = radius[i] - d
            which[i] = c


@kernel
def aim_shapes(
    # In:
    which: wp.array[wp.int32],  # [aimed_count]
    place: wp.array[Vec3],  # [aimed_count] where they are at the end of the frame [m]
    turn: wp.array[Quat],  # [aimed_count]
    dt: Real,  # of the frame [s]
    # State:
    centre: wp.array[Vec3],  # [shape_count] [m]
    rotation: wp.array[Quat],  # [shape_count]
    # Out:
    velocity: wp.array[Vec3],  # [shape_count] [m/s]
    spin: wp.array[Vec3],  # [shape_count] [rad/s]
):
    """Velocity and spin that take each there within a frame, from where it really is: rounding does not add up."""
    k = wp.tid()
    c = which[k]
    velocity[c] = (place[k] - centre[c]) / dt
    q = turn[k] * wp.quat_inverse(rotation[c])
    axis = Vec3(q[0], q[1], q[2])
    size = wp.length(axis)
    spin[c] = Vec3()
    if size > Real(0.0):
        angle = Real(2.0) * wp.atan2(size, wp.abs(q[3]))  # the shorter way round
        spin[c] = (wp.where(q[3] < Real(0.0), -angle, angle) / (dt * size)) * axis
