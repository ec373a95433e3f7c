"""A plane through the origin; its size is its normal."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Vec3, func


@func
def plane(normal: Vec3, s: Vec3):
    """Distance of s [m], and the normal there."""
    return wp.dot(normal, s), normal
