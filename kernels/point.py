"""Point constraint: locks a particle to a coordinate that may move.

C(p_i) = p_i - q (three equations, gradient the identity)
Source: ours; the vector form of Mueller et al. 2007, section 3.3.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, index, step_pass


@step_pass
def project_point(
    k: wp.int32,
    # Model:
    particle: wp.array[wp.int32],  # [point_count]
    target: wp.array[Vec3],  # [point_count] [m]
    stiffness: wp.array[Real],  # [point_count] k' of one iteration, or None: all 1
    compliance: wp.array[Real],  # [point_count] [m/N], or None: all 0
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    u: wp.array[Vec3],  # [particle_count] [m]
    valence: wp.array[wp.int32],  # [particle_count] constraints at each particle, or None: masses are not split
    relaxation: Real,
    compliance_scale: wp.array[Real],  # [1] [1/s^2]: compliance times it is XPBD's alpha~
    mean_gradient: wp.bool,  # of a compliant point: the mean of C before and after the step
    # Out:
    lam: wp.array[Vec3],  # [point_count] multiplier [kg m], only with compliance
    residual: wp.array[Real],  # [1] largest |C + a lam| [m], or None: not wanted
    correction: wp.array[Vec3],  # [particle_count] [m], added to
):
    """Line 10 for points: dlam = -(C + a lam) / (n_i w_i + a), p += w dlam."""
    i = index(particle[k])
    weight = w[i]
    if valence:
        weight = Real(valence[i]) * weight
    if weight > Real(0.0):
        c = (x[i] - target[k]) + u[i]
        if compliance:
            a = compliance[k] * compliance_scale[0]
            if mean_gradient and a > Real(0.0):
                c = c + (x[i] - target[k])
                a = a + a
            c = c + a * lam[k]
            weight = weight + a
        if residual:
            wp.atomic_max(residual, 0, wp.length(c))
        if stiffness:
            c = c * stiffness[k]
        dlam = c * (-relaxation / weight)
        if compliance:
            lam[k] = lam[k] + dlam
        wp.atomic_add(correction, i, w[i] * dlam)
