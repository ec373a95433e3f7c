"""Counting iterations and deciding on the device whether there is another one."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, step_pass


@step_pass
def begin_iterations(
    i: wp.int32,
    # Out:
    count: wp.array[wp.int32],  # [1] iterations in this step
    another: wp.array[wp.int32],  # [1] 1: there is another iteration
    residual: wp.array[Real],  # [1] [m]
):
    count[0] = 0
    another[0] = 1
    residual[0] = Real(0.0)


@step_pass
def end_iteration(
    i: wp.int32,
    # In:
    tolerance: Real,  # [m]
    iterations: wp.int32,  # at most
    # Out:
    residual: wp.array[Real],  # [1] as the sweep found it, set to zero for the next one [m]
    count: wp.array[wp.int32],
    another: wp.array[wp.int32],
    iterations_used: wp.array[wp.int32],  # [1] in the frame
    unconverged: wp.array[wp.int32],  # [1] steps of the frame that stopped above the tolerance
):
    count[0] = count[0] + 1
    iterations_used[0] = iterations_used[0] + 1
    # A residual that is not a number is above every tolerance.
    converged = residual[0] <= tolerance
    if converged or count[0] >= iterations:
        another[0] = 0
        if not converged:
            unconverged[0] = unconverged[0] + 1
    residual[0] = Real(0.0)
