"""Links as capsules: where two of them are closest, and when they first touch on the way x -> x + u.

A capsule is all that is within a radius of a segment a(s) = a_0 + s d_a, 0 <= s <= 1; the radius goes from one end's to
the other's. One without length is a ball.

Closest points minimise |a(s) - b(t)|^2 + DELTA L min(L, R) ((s - 1/2)^2 + (t - 1/2)^2), L^2 the mean of |d_a|^2 and
|d_b|^2, R the sum of radii: so those of links that are parallel are unique, at their middles, and move slowly where
links are nearly parallel. Others move by at most DELTA R / 2 each, so touching ones are DELTA^2 R / 4 further apart.
Source: Ericson 2005, Real-Time Collision Detection, section 5.1.9; the regularisation is ours.

First touch: along any unit vector n the capsules are apart by at least min over ends (n . (a_i - b_j) - r_i - r_j),
which moves linearly with time for each pair of ends. With n between the closest points that is the distance itself, so
the first moment at which a pair of ends makes it 0 is never after the first touch: from there again, until they touch
or the step is over. (Conservative advancement, Mirtich 1996, with a bound that knows the direction.)
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func

DELTA = wp.constant(0.01)
"""How hard closest points are pulled to the middles."""

TOUCH = wp.constant(0.01)
"""Of the sum of radii: what is nearer than this touches."""

ADVANCES = wp.constant(24)
"""Most steps in time; what is on its way still, counts as touching where it has come to: that errs on the safe side."""


@wp.func
def nearest_points(apart: Any, d_a: Any, d_b: Any, thick: Any):
    """s and t of the closest points, where apart = a_0 - b_0 and thick is the sum of radii."""
    zero = type(thick)(0.0)
    one = type(thick)(1.0)
    half = type(thick)(0.5)
    size_a = wp.dot(d_a, d_a)
    size_b = wp.dot(d_b, d_b)
    length = wp.sqrt(half * (size_a + size_b))
    pull = type(thick)(DELTA) * length * wp.min(length, thick)
    s = type(thick)(0.0)
    t = type(thick)(0.0)
    if pull > zero:
        aa = size_a + pull
        bb = size_b + pull
        ab = wp.dot(d_a, d_b)
        c = wp.dot(d_a, apart) - half * pull
        f = wp.dot(d_b, apart) + half * pull
        s = wp.clamp((ab * f - c * bb) / (aa * bb - ab * ab), zero, one)
        t = wp.clamp((ab * s + f) / bb, zero, one)
        s = wp.clamp((ab * t - c) / aa, zero, one)
    return s, t


@func
def across(d_a: Vec3, d_b: Vec3):
    """A unit vector that parts two segments whose axes meet: normal to both, or to one where they are parallel."""
    n = wp.cross(d_a, d_b)
    if wp.dot(n, n) <= Real(1.0e-12) * wp.dot(d_a, d_a) * wp.dot(d_b, d_b):
        d = d_a
        if wp.dot(d_b, d_b) > wp.dot(d_a, d_a):
            d = d_b
        n = wp.cross(d, Vec3(Real(1.0), Real(0.0), Real(0.0)))
        if wp.abs(d[0]) > wp.abs(d[1]):
            n = wp.cross(d, Vec3(Real(0.0), Real(1.0), Real(0.0)))
    if wp.dot(n, n) == Real(0.0):
        return Vec3(Real(0.0), Real(1.0), Real(0.0))
    return wp.normalize(n)


@func
def time_to(apart: Real, closing: Real):
    """When what closes with -closing a step has gone `apart`; never (2) where it does not close."""
    if closing < Real(0.0):
        return wp.max(apart, Real(0.0)) / -closing
    return Real(2.0)


@func
def meet(
    apart: Vec3,  # a_0 - b_0 when the step begins
    d_a: Vec3,
    d_b: Vec3,
    move: Vec3,  # what a step adds to each of those
    turn_a: Vec3,
    turn_b: Vec3,
    r_a0: Real,
    r_a1: Real,
    r_b0: Real,
    r_b1: Real,
):
    """How near two capsules come in a step, and where: gap, s, t and the direction n from b to a; at the first touch,
    where there is one."""
    time = Real(0.0)
    gap = Real(0.0)
    s = Real(0.0)
    t = Real(0.0)
    n = Vec3()
    nearest = Real(1.0e30)
    nearest_s = Real(0.0)
    nearest_t = Real(0.0)
    nearest_n = Vec3()
    thick = wp.max(r_a0, r_a1) + wp.max(r_b0, r_b1)
    fastest = wp.max(
        wp.max(wp.length(move), wp.length(move + turn_a)),
        wp.max(wp.length(move - turn_b), wp.length(move + turn_a - turn_b)),
    )
    k = int(0)
    while k < ADVANCES:
        from_b = apart + time * move
        a = d_a + time * turn_a
        b = d_b + time * turn_b
        s, t = nearest_points(from_b, a, b, thick)
        between = from_b + s * a - t * b
        far = wp.length(between)
        rest = r_a0 + s * (r_a1 - r_a0) + r_b0 + t * (r_b1 - r_b0)
        gap = far - rest
        if far > Real(1.0e-6) * rest:
            n = between / far
        else:
            n = across(a, b)
        if gap < nearest:
            nearest = gap
            nearest_s = s
            nearest_t = t
            nearest_n = n
        k = k + 1
        if gap <= Real(TOUCH) * rest or time >= Real(1.0):
            k = ADVANCES
        else:
            # Along n, each pair of ends by itself.
            along = wp.dot(n, from_b)
            closing = wp.dot(n, move)
            more_a = wp.dot(n, a)
            more_b = wp.dot(n, b)
            turning_a = wp.dot(n, turn_a)
            turning_b = wp.dot(n, turn_b)
            step = wp.min(
                wp.min(
                    time_to(along - r_a0 - r_b0, closing),
                    time_to(along + more_a - r_a1 - r_b0, closing + turning_a),
                ),
                wp.min(
                    time_to(along - more_b - r_a0 - r_b1, closing - turning_b),
                    time_to(along + more_a - more_b - r_a1 - r_b1, closing + turning_a - turning_b),
                ),
            )
            time = wp.min(time + wp.max(step, gap / fastest), Real(1.0))
            if k == ADVANCES:
                # Still on its way: as near as it will come, for all that is known.
                nearest = wp.min(nearest, Real(0.0))
    return nearest, nearest_s, nearest_t, nearest_n
