"""Kinematic particles (w = 0): they move with their velocity, which nothing else changes."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, kernel


@kernel
def move_to_targets(
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    # In:
    particle: wp.array[wp.int32],  # [moved_count]
    target: wp.array[Vec3],  # [moved_count] where they are at the end of the frame [m]
    dt: Real,  # of the frame [s]
    # Out:
    v: wp.array[Vec3],  # [particle_count] [m/s]
):
    """The velocity that takes each to its target within a frame, from where it really is: rounding does not add up."""
    k = wp.tid()
    i = particle[k]
    v[i] = (target[k] - x[i]) / dt


@kernel
def stop(
    # In:
    particle: wp.array[wp.int32],  # [moved_count]
    # Out:
    v: wp.array[Vec3],  # [particle_count] [m/s]
):
    v[particle[wp.tid()]] = Vec3()
