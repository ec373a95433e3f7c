"""A sphere around the origin; its size is (radius, -, -) [m]."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func


@func
def sphere(size: Vec3, s: Vec3):
    """Distance of s [m], and the normal there; the centre itself goes out along x."""
    away = wp.length(s)
    n = Vec3(Real(1.0), Real(0.0), Real(0.0))
    if away > Real(0.0):
        n = s / away
    return away - size[0], n
