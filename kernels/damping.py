"""dampVelocities: takes velocity that is not rigid motion, and keeps all that is.

    x_cm = sum m x / sum m,  v_cm = sum m v / sum m
    L = sum r x (m v),  I = sum m (|r|^2 1 - r r^T),  omega = I^+ L       with r = x - x_cm
    v += k (v_cm + omega x r - v)
Source: Mueller et al. 2007, section 3.5, lines (1)-(9); here for each connected component by itself.

I^+ is the pseudo-inverse: a straight rope, two particles or one have no inertia about some axis, and so no
angular momentum either. Fixed and grabbed particles (w = 0) take no part. Sums are taken relative to
the component's first particle, so that they do not cancel far from the origin.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Mat33, Real, Vec3, step_pass


@step_pass
def sum_momentum(
    i: wp.int32,
    # Model:
    component: wp.array[wp.int32],  # [particle_count]
    first: wp.array[wp.int32],  # [component_count] a particle of each
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    v: wp.array[Vec3],  # [particle_count] [m/s]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # Out:
    mass: wp.array[Real],  # [component_count] [kg]
    moment: wp.array[Vec3],  # [component_count] sum m (x - x_first) [kg m]
    momentum: wp.array[Vec3],  # [component_count] sum m v [kg m/s]
):
    if w[i] > Real(0.0):
        c = component[i]
        m = Real(1.0) / w[i]
        wp.atomic_add(mass, c, m)
        wp.atomic_add(moment, c, m * (x[i] - x[first[c]]))
        wp.atomic_add(momentum, c, m * v[i])


@step_pass
def divide_by_mass(
    c: wp.int32,
    # In:
    mass: wp.array[Real],  # [component_count] [kg]
    # Out:
    centre: wp.array[Vec3],  # [component_count] the moment before, x_cm - x_first after [m]
    velocity: wp.array[Vec3],  # [component_count] the momentum before, v_cm after [m/s]
):
    """Once a component: six divisions a particle would be most of the work."""
    centre[c] = centre[c] / mass[c]
    velocity[c] = velocity[c] / mass[c]


@step_pass
def sum_angular_momentum(
    i: wp.int32,
    # Model:
    component: wp.array[wp.int32],
    first: wp.array[wp.int32],
    # State:
    x: wp.array[Vec3],
    v: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    centre: wp.array[Vec3],  # [component_count] x_cm - x_first [m]
    velocity: wp.array[Vec3],  # [component_count] v_cm [m/s]
    # Out:
    angular_momentum: wp.array[Vec3],  # [component_count] [kg m^2/s]
    inertia: wp.array[Mat33],  # [component_count] [kg m^2]
):
    if w[i] > Real(0.0):
        c = component[i]
        m = Real(1.0) / w[i]
        r = (x[i] - x[first[c]]) - centre[c]
        wp.atomic_add(angular_momentum, c, m * wp.cross(r, v[i] - velocity[c]))
        one = wp.identity(3, dtype=Real)
        wp.atomic_add(inertia, c, m * (wp.dot(r, r) * one - wp.outer(r, r)))


@step_pass
def find_rotation(
    c: wp.int32,
    # In:
    angular_momentum: wp.array[Vec3],  # [component_count]
    inertia: wp.array[Mat33],  # [component_count]
    cutoff: Real,  # smallest eigenvalue that counts, relative to the largest
    # Out:
    omega: wp.array[Vec3],  # [component_count] [rad/s]
):
    """omega = I^+ L. By Cramer's rule, but an axis without inertia does not turn.

    No moment of a body exceeds the sum of the other two. So where the smallest is 0 the others are equal, half the
    trace: the body is a straight line, and omega = L / (trace / 2) for the part of L across it. The line's direction is
    the largest row of the adjugate, which is then lam_1 lam_2 a a^T; its trace tells the smallest moment from the
    determinant. (An eigenvalue iteration would do it all, takes ten times as long, and leaves noise out of the plane of
    a plane motion, whose squares are denormal numbers in float32, slow ones.)
    """
    omega[c] = Vec3()
    mean = wp.trace(inertia[c]) / Real(3.0)
    if mean > Real(0.0):
        scaled = inertia[c] / mean  # the determinant of a small body's inertia would underflow
        turn = angular_momentum[c] / mean
        row_0 = Vec3(scaled[0, 0], scaled[0, 1], scaled[0, 2])
        row_1 = Vec3(scaled[1, 0], scaled[1, 1], scaled[1, 2])
        row_2 = Vec3(scaled[2, 0], scaled[2, 1], scaled[2, 2])
        adjugate_0 = wp.cross(row_1, row_2)
        adjugate_1 = wp.cross(row_2, row_0)
        adjugate_2 = wp.cross(row_0, row_1)
        determinant = wp.dot(row_0, adjugate_0)
        minors = adjugate_0[0] + adjugate_1[1] + adjugate_2[2]
        if determinant > cutoff * Real(1.5) * minors:
            solved = Vec3(wp.dot(adjugate_0, turn), wp.dot(adjugate_1, turn), wp.dot(adjugate_2, turn))
            omega[c] = solved / determinant
        else:
            line = adjugate_0
            if adjugate_1[1] > wp.max(adjugate_0[0], adjugate_2[2]):
                line = adjugate_1
            elif adjugate_2[2] > adjugate_0[0]:
                line = adjugate_2
            line = wp.normalize(line)
            omega[c] = (turn - wp.dot(line, turn) * line) / Real(1.5)


@step_pass
def damp_velocities(
    i: wp.int32,
    # Model:
    component: wp.array[wp.int32],
    first: wp.array[wp.int32],
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    centre: wp.array[Vec3],  # [component_count] x_cm - x_first [m]
    velocity: wp.array[Vec3],  # [component_count] v_cm [m/s]
    omega: wp.array[Vec3],
    damping: Real,  # k of one step, 0..1
    # Out:
    v: wp.array[Vec3],
):
    """Lines (6)-(9) of section 3.5."""
    if w[i] > Real(0.0):
        c = component[i]
        r = (x[i] - x[first[c]]) - centre[c]
        rigid = velocity[c] + wp.cross(omega[c], r)
        v[i] = v[i] + damping * (rigid - v[i])
