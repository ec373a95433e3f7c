"""What a Jacobi sweep does between two evaluations of the constraints."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, kernel


@kernel
def add_corrections(
    # In:
    divisor: wp.array[wp.int32],  # [particle_count] constraints at each particle, or None: the plain sum
    # Out:
    correction: wp.array[Vec3],  # [particle_count] taken and set to zero for the next sweep
    u: wp.array[Vec3],  # [particle_count] added to
):
    """u += correction (over the particle's own number of constraints with "valence" averaging)."""
    i = wp.tid()
    delta = correction[i]
    if divisor:
        delta = delta / Real(wp.max(divisor[i], 1))
    u[i] = u[i] + delta
    correction[i] = Vec3()
