"""Distance constraint between two particles.

C(p_i, p_j) = |p_i - p_j| - d
Source: Mueller et al. 2007, Position Based Dynamics, section 3.3, eqs. (10), (11);
compliance: Macklin et al. 2016, XPBD, eq. (18).

The positions enter as p_i - p_j = (x_i - x_j) + (u_i - u_j): the difference of two stored positions is exact
to their rounding, so the constraint keeps its accuracy far from the origin.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, index, kernel, step_pass


@wp.func
def distance(d: Any, rest: Any):
    """C = |d| - rest [m] and its gradient in the first end (the second's is the opposite).

    A pair of zero length has no direction; the x axis stands in, so that it separates instead of making NaN.
    """
    length = wp.length(d)
    zero = type(rest)(0.0)
    direction = wp.vector(type(rest)(1.0), zero, zero)
    if length > zero:
        direction = d / length
    return length - rest, direction


@wp.func
def distance_over_step(start: Any, move: Any, rest: Any, compliance: Any, mean_gradient: wp.bool):
    """A distance as a step sees it, from d_0 = start to d_1 = start + move.

    Gives C, n = d_1/|d_1|, the force direction g, the length that g was divided by, and the compliance. For most
    integrators g = n. "midpoint" takes g = (d_0 + d_1)/(|d_0| + |d_1|): then g . move is exactly |d_1| - |d_0|, so a
    rigid link does no work, and a compliant one, with the mean of C at both ends (here doubled, and the compliance
    with it), the work of its potential energy.
    """
    end = start + move
    c, n = distance(end, rest)
    g = n
    size = wp.length(end)
    a = compliance
    if mean_gradient:
        length = wp.length(start)
        size = size + length
        if size > type(rest)(0.0):
            g = (start + end) / size
        if compliance > type(rest)(0.0):
            c = c + (length - rest)
            a = compliance + compliance
    return c, n, g, size, a


@step_pass
def limit_lengths(
    k: wp.int32,
    # Model:
    edge: wp.array[wp.vec2i],  # [edge_count]
    rest_length: wp.array[Real],  # [edge_count] [m]
    compliant: wp.array[wp.int32],  # [edge_count] 1: its error is its force, and stays
    # State:
    x: wp.array[Vec3],
    # In:
    depenetration: Real,  # what a step may take back of the error that it starts with [m]
    # Out:
    rest_now: wp.array[Real],  # [edge_count] length that this step asks for [m]
):
    """A rope that was pulled too long and is let go would otherwise take all of it back in one step, and leave at
    that speed."""
    length = wp.length(x[edge[k][0]] - x[edge[k][1]])
    rest_now[k] = rest_length[k]
    if compliant[k] == 0:
        rest_now[k] = wp.clamp(rest_length[k], length - depenetration, length + depenetration)


@kernel
def measure_distance(
    # Model:
    edge: wp.array[wp.vec2i],  # [edge_count]
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    # Out:
    length: wp.array[Real],  # [edge_count] [m]
):
    """Lengths to the last bit as project_distance sees them."""
    k = wp.tid()
    d = x[edge[k][0]] - x[edge[k][1]]
    size, direction = distance(d, Real(0.0))
    length[k] = size


@step_pass
def project_distance(
    k: wp.int32,
    # Model:
    edge: wp.array[wp.vec2i],  # [edge_count]
    rest_length: wp.array[Real],  # [edge_count] [m]
    stiffness: wp.array[Real],  # [edge_count] k' of one iteration, or None: all 1
    compliance: wp.array[Real],  # [edge_count] [m/N], or None: all 0
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    u: wp.array[Vec3],  # [particle_count] [m]
    valence: wp.array[wp.int32],  # [particle_count] constraints at each particle, or None: masses are not split
    relaxation: Real,
    compliance_scale: wp.array[Real],  # [1] [1/s^2]: compliance times it is XPBD's alpha~
    mean_gradient: wp.bool,  # force along the mean of the configurations before and after the step
    # Out:
    lam: wp.array[Real],  # [edge_count] multiplier [kg m], only with compliance
    residual: wp.array[Real],  # [1] largest |C + a lam| [m], or None: not wanted
    correction: wp.array[Vec3],  # [particle_count] [m], added to
):
    """Line 10 for distances: dlam = -(C + a lam) / (n_i w_i + n_j w_j + a), p += w dlam grad C."""
    i = index(edge[k][0])
    j = index(edge[k][1])
    w_i = w[i]
    w_j = w[j]
    weight = w_i + w_j
    if valence:
        weight = Real(valence[i]) * w_i + Real(valence[j]) * w_j
    if weight > Real(0.0):
        alpha = Real(0.0)
        if compliance:
            alpha = compliance[k] * compliance_scale[0]
        c, n, g, size, a = distance_over_step(x[i] - x[j], u[i] - u[j], rest_length[k], alpha, mean_gradient)
        if compliance:
            c = c + a * lam[k]
        if residual:
            wp.atomic_max(residual, 0, wp.abs(c))
        if stiffness:
            c = c * stiffness[k]
        dlam = -relaxation * c / (weight + a)
        if compliance:
            lam[k] = lam[k] + dlam
        wp.atomic_add(correction, i, (w_i * dlam) * g)
        wp.atomic_sub(correction, j, (w_j * dlam) * g)
