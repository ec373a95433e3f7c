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
    mass: wp.array[Real],
    moment: wp.array[Vec3],
    momentum: wp.array[Vec3],
    # Out:
    angular_momentum: wp.array[Vec3],  # [component_count] [kg m^2/s]
    inertia: wp.array[Mat33],  # [component_count] [kg m^2]
):
    if w[i] > Real(0.0):
        c = component[i]
        m = Real(1.0) / w[i]
        r = (x[i] - x[first[c]]) - moment[c] / mass[c]
        wp.atomic_add(angular_momentum, c, m * wp.cross(r, v[i] - momentum[c] / mass[c]))
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
    """omega = I^+ L, by eigenvalues: an axis without inertia does not turn."""
    axes, moments = wp.eig3(inertia[c])
    largest = wp.max(moments)
    result = Vec3()
    for k in range(3):
        if moments[k] > cutoff * largest:
            axis = Vec3(axes[0, k], axes[1, k], axes[2, k])
            result = result + axis * (wp.dot(axis, angular_momentum[c]) / moments[k])
    omega[c] = result


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
    mass: wp.array[Real],
    moment: wp.array[Vec3],
    momentum: wp.array[Vec3],
    omega: wp.array[Vec3],
    damping: Real,  # k of one step, 0..1
    # Out:
    v: wp.array[Vec3],
):
    """Lines (6)-(9) of section 3.5."""
    if w[i] > Real(0.0):
        c = component[i]
        r = (x[i] - x[first[c]]) - moment[c] / mass[c]
        rigid = momentum[c] / mass[c] + wp.cross(omega[c], r)
        v[i] = v[i] + damping * (rigid - v[i])
