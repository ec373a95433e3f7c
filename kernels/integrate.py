"""Velocity integration, prediction and the way back: lines 5, 7 and 12-15 of Mueller et al. 2007, section 3.1.

The unknown of a step is the displacement u = p - x, never p itself. In float32 p = x + dt v loses a small
dt v altogether (at x = 10 m and dt = 1/6000 s a falling particle would never move), and v = (p - x) / dt
would hand that loss on to the velocity. With u the velocity sees no rounding of the position at all.

A drag of c [1/s], the force -c m v on each free particle, is part of the step's balance, with the velocity that the
integrator forms from u: so u and the forces' way to it are divided by 1 + c dt here, 1 + c dt/2 in midpoint.py, and
1 + 2 c dt/3 in bdf2.py, where the displacement before adds (2 c dt/9) u_before. It keeps every integrator's order.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, step_pass


@wp.func
def move(i: wp.int32, u: wp.array[Any], x: wp.array[Any], diverged: wp.array[wp.int32]):
    """Line 14, x += u; notes the particle where that is not finite."""
    x[i] = x[i] + u[i]
    if not wp.isfinite(x[i]):
        wp.atomic_min(diverged, 0, i)


@step_pass
def accelerate(
    i: wp.int32,
    # Model:
    gravity: Vec3,  # [m/s^2]
    # State:
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    dt: Real,  # [s]
    # Out:
    v: wp.array[Vec3],  # [particle_count] [m/s]
):
    """Line 5 by itself, for steps in which line 6 comes before line 7."""
    if w[i] > Real(0.0):
        v[i] = v[i] + dt * gravity


@step_pass
def predict(
    i: wp.int32,
    # Model:
    gravity: Vec3,  # [m/s^2], zero where line 5 has run already
    # State:
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    dt: Real,  # [s]
    keep: Real,  # what drag leaves of the displacement, 1 without
    # Out:
    v: wp.array[Vec3],  # [particle_count] [m/s]
    u: wp.array[Vec3],  # [particle_count] [m]
):
    """Lines 5 and 7: v += dt g, u = dt v."""
    if w[i] > Real(0.0):
        v[i] = v[i] + dt * gravity
        u[i] = keep * (dt * v[i])
    else:
        u[i] = dt * v[i]


@step_pass
def update(
    i: wp.int32,
    # In:
    u: wp.array[Vec3],  # [particle_count] [m]
    dt: Real,  # [s]
    # Out:
    x: wp.array[Vec3],  # [particle_count] [m]
    v: wp.array[Vec3],  # [particle_count] [m/s]
    diverged: wp.array[wp.int32],  # [5] first: lowest particle whose step is not finite; the others: divergence.py
):
    """Lines 12-15: v = u / dt, x += u."""
    v[i] = u[i] / dt
    move(i, u, x, diverged)
