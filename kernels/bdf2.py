"""The second-order backward differentiation formula, prediction and the way back.

    u = (x_n - x_{n-1})/3 + (2 dt/9)(4 v_n - v_{n-1}) + (4 dt^2/9) g
    v_{n+1} = (3 x_{n+1} - 4 x_n + x_{n-1}) / (2 dt) = (3 u - u_before) / (2 dt)
Source: Hairer, Wanner: Solving Ordinary Differential Equations II, section III.1 (BDF2 for x' = v, v' = a, solved for
x_{n+1}), in displacements u = x_{n+1} - x_n, u_before = x_n - x_{n-1}.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.integrate import move
from pbd_warp.kernels.precision import Real, Vec3, step_pass


@step_pass
def predict_bdf2(
    i: wp.int32,
    # Model:
    gravity: Vec3,  # [m/s^2]
    # State:
    v: wp.array[Vec3],  # [particle_count] [m/s]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    dt: Real,  # [s]
    drag: Real,  # [1/s], as in integrate.py
    history: wp.array[wp.int32],  # [1] 0: there is no step before this one
    u_before: wp.array[Vec3],  # [particle_count] [m]
    v_before: wp.array[Vec3],  # [particle_count] [m/s]
    # Out:
    u: wp.array[Vec3],  # [particle_count] [m]
):
    if w[i] == Real(0.0):
        u[i] = dt * v[i]
    elif history[0] == 0:
        u[i] = dt * (v[i] + dt * gravity)
        if drag > Real(0.0):
            u[i] = u[i] / (Real(1.0) + drag * dt)
    else:
        inertia = u_before[i] / Real(3.0) + (Real(2.0) * dt / Real(9.0)) * (Real(4.0) * v[i] - v_before[i])
        free = inertia + (Real(4.0) * dt * dt / Real(9.0)) * gravity
        if drag > Real(0.0):
            third = Real(2.0) * drag * dt / Real(3.0)
            free = (free + (third / Real(3.0)) * u_before[i]) / (Real(1.0) + third)
        u[i] = free


@step_pass
def update_bdf2(
    i: wp.int32,
    # State:
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    u: wp.array[Vec3],  # [particle_count] [m]
    dt: Real,  # [s]
    history: wp.array[wp.int32],  # [1]
    # Out:
    u_before: wp.array[Vec3],  # [particle_count] [m]
    v_before: wp.array[Vec3],  # [particle_count] [m/s]
    x: wp.array[Vec3],  # [particle_count] [m]
    v: wp.array[Vec3],  # [particle_count] [m/s]
    diverged: wp.array[wp.int32],  # [5], as in integrate.py
):
    """A particle that is led (w = 0) has the velocity of its way; so has every one in the first step."""
    v_new = u[i] / dt
    if history[0] != 0 and w[i] > Real(0.0):
        v_new = (Real(3.0) * u[i] - u_before[i]) / (Real(2.0) * dt)
    v_before[i] = v[i]
    u_before[i] = u[i]
    v[i] = v_new
    move(i, u, x, diverged)


@step_pass
def remember(
    i: wp.int32,
    # In:
    compliance_scale_then: Real,  # of all steps but the first [1/s^2]
    # Out:
    history: wp.array[wp.int32],  # [1]
    compliance_scale: wp.array[Real],  # [1] [1/s^2]
):
    """From now on there is a step before."""
    history[0] = 1
    compliance_scale[0] = compliance_scale_then
