"""What a Jacobi sweep does between two evaluations of the constraints."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, step_pass


@step_pass
def add_corrections(
    i: wp.int32,
    # In:
    divisor: wp.array[wp.int32],  # [particle_count] constraints at each particle, or None: the plain sum
    # Out:
    correction: wp.array[Vec3],  # [particle_count] taken and set to zero for the next sweep
    u: wp.array[Vec3],  # [particle_count] added to
):
    """u += correction (over the particle's own number of constraints with "valence" averaging)."""
    delta = correction[i]
    if divisor:
        delta = delta / Real(wp.max(divisor[i], 1))
    u[i] = u[i] + delta
    correction[i] = Vec3()


@step_pass
def add_corrections_accelerated(
    i: wp.int32,
    # In:
    divisor: wp.array[wp.int32],  # as above
    omega: wp.array[Real],  # factor of each iteration
    count: wp.array[wp.int32],  # [1] this iteration, counted from 1, or None: the first of omega
    another: wp.array[wp.int32],  # [1] 0: this is the last, or None: not known here
    # Out:
    correction: wp.array[Vec3],  # [particle_count] taken and set to zero
    u_before: wp.array[Vec3],  # [particle_count] of the iteration before this one
    u: wp.array[Vec3],  # [particle_count]
):
    """Chebyshev's semi-iteration: u <- omega (u + correction - u_before) + u_before.

    Source: Wang 2015, A Chebyshev Semi-Iterative Approach for Accelerating Projective and Position-based Dynamics.
    """
    delta = correction[i]
    if divisor:
        delta = delta / Real(wp.max(divisor[i], 1))
    factor = omega[0]
    if count:
        factor = omega[count[0] - 1]
        if another[0] == 0:
            # The residual that ended the iteration was met before this update, which must not raise it again.
            factor = Real(1.0)
    moved = u[i] + delta
    if factor != Real(1.0):
        moved = factor * (moved - u_before[i]) + u_before[i]
    u_before[i] = u[i]
    u[i] = moved
    correction[i] = Vec3()
