"""A cone along y around the origin, cut or whole, or a cylinder where both radii are equal.

Its size is (radius at the lower end, radius at the upper end, half its height) [m]. It is a convex polygon in the
half-plane (rho, y), turned around y: the distance is that of the polygon.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func


@func
def cone(size: Vec3, s: Vec3):
    """Distance of s [m], negative inside, and the normal there; the axis itself goes out along x."""
    zero = Real(0.0)
    rho = wp.sqrt(s[0] * s[0] + s[2] * s[2])
    radial = Vec3(Real(1.0), zero, zero)
    if rho > zero:
        radial = Vec3(s[0] / rho, zero, s[2] / rho)
    half = size[2]
    end = wp.sign(s[1])  # of the two caps the nearer one
    slant = wp.sqrt((size[1] - size[0]) * (size[1] - size[0]) + Real(4.0) * half * half)
    along_rho = (size[1] - size[0]) / slant
    along_y = Real(2.0) * half / slant
    beside = along_y * (rho - size[0]) - along_rho * (s[1] + half)  # the side's line
    beyond = end * s[1] - half  # the cap's line
    d = beside
    n_rho = along_y
    n_y = -along_rho
    if beside <= zero and beyond <= zero:
        if beyond > beside:
            d = beyond
            n_rho = zero
            n_y = end
    else:
        t = along_rho * (rho - size[0]) + along_y * (s[1] + half)
        if t < zero or t > slant:
            t = wp.clamp(t, zero, slant)
            out_rho = rho - (size[0] + t * along_rho)
            out_y = s[1] - (t * along_y - half)
            d = wp.sqrt(out_rho * out_rho + out_y * out_y)
            if d > zero:
                n_rho = out_rho / d
                n_y = out_y / d
        rim = size[0]
        if end > zero:
            rim = size[1]
        if beyond > zero and rho <= rim:
            d = beyond
            n_rho = zero
            n_y = end
    return d, n_rho * radial + Vec3(zero, n_y, zero)
