"""Setting and copying memory, in words of 4 bytes, whatever they mean."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import step_pass


@step_pass
def zero(
    i: wp.int32,
    # Out:
    target: wp.array[wp.int32],
):
    target[i] = 0


@step_pass
def copy(
    i: wp.int32,
    # In:
    source: wp.array[wp.int32],
    # Out:
    target: wp.array[wp.int32],
):
    target[i] = source[i]
