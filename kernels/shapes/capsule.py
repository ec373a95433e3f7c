"""A capsule along y around the origin; its size is (radius, half the distance of its ends' centres, -) [m]."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func


@func
def capsule(size: Vec3, s: Vec3):
    """Distance of s [m], negative inside, and the normal there; the axis itself goes out along x."""
    out = s - Vec3(Real(0.0), wp.clamp(s[1], -size[1], size[1]), Real(0.0))
    away = wp.length(out)
    n = Vec3(Real(1.0), Real(0.0), Real(0.0))
    if away > Real(0.0):
        n = out / away
    return away - size[0], n
