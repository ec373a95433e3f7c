"""A box around the origin, its edges along the axes; its size is half of each of them [m]."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func


@func
def box(size: Vec3, s: Vec3):
    """Distance of s [m], negative inside, and the normal there; from inside the way out is that to the nearest face."""
    zero = Real(0.0)
    side = Vec3(wp.sign(s[0]), wp.sign(s[1]), wp.sign(s[2]))
    beyond = wp.cw_mul(side, s) - size
    d = wp.max(beyond)
    n = Vec3()
    if d > zero:
        out = wp.max(beyond, Vec3())
        d = wp.length(out)
        n = wp.cw_mul(side, out) / d
    elif beyond[0] >= d:
        n = Vec3(side[0], zero, zero)
    elif beyond[1] >= d:
        n = Vec3(zero, side[1], zero)
    else:
        n = Vec3(zero, zero, side[2])
    return d, n
