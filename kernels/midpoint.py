"""The implicit midpoint rule, prediction and the way back.

    u = dt v_n + (dt^2/2) g + W G(mean configuration) lam,   v_{n+1} = 2 u / dt - v_n
Source: Hairer, Lubich, Wanner: Geometric Numerical Integration, sections II.1 and VII.1; with forces along the
discrete gradient of distance.py it conserves energy and angular momentum exactly (Gonzalez 1996).
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.integrate import move
from pbd_warp.kernels.precision import Real, Vec3, step_pass


@step_pass
def predict_midpoint(
    i: wp.int32,
    # Model:
    gravity: Vec3,  # [m/s^2]
    # State:
    v: wp.array[Vec3],  # [particle_count] [m/s]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    dt: Real,  # [s], negative in the third step of "midpoint4"
    keep: Real,  # as in integrate.py
    # Out:
    u: wp.array[Vec3],  # [particle_count] [m]
):
    if w[i] == Real(0.0):
        u[i] = dt * v[i]
    else:
        u[i] = keep * (dt * v[i] + (Real(0.5) * dt * dt) * gravity)


@step_pass
def update_midpoint(
    i: wp.int32,
    # State:
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    u: wp.array[Vec3],  # [particle_count] [m]
    dt: Real,  # [s]
    # Out:
    x: wp.array[Vec3],  # [particle_count] [m]
    v: wp.array[Vec3],  # [particle_count] [m/s]
    diverged: wp.array[wp.int32],  # [5], as in integrate.py
):
    """A particle that is led (w = 0) has the velocity of its way."""
    v_new = u[i] / dt
    if w[i] > Real(0.0):
        v_new = v_new + (v_new - v[i])
    v[i] = v_new
    move(i, u, x, diverged)
