"""Whether a frame has left what is possible: links far beyond their length, energy from nowhere.

Both write to `diverged`, which is read once a frame; positions that are not finite are noted there by the step itself
(integrate.py), and contacts beyond the room for them (contact.py).
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, index, step_pass

PARTICLE = wp.constant(0)  # places in `diverged`: the lowest particle that is not finite,
EDGE = wp.constant(1)  # the lowest edge stretched beyond the limit,
ENERGY = wp.constant(2)  # 0 where energy has risen beyond the limit,
PIECE = wp.constant(3)  # the first particle of a piece that an explicit integrator found no step for,
CONTACTS = wp.constant(4)  # the most contacts wanted beyond the room for them, 0 if all fitted

NOTHING = wp.constant(2**31 - 1)
"""In all places but the last: nothing to tell."""

CHUNK = wp.constant(64)
"""Particles a thread sums before it adds to the total: on a GPU 64 times fewer atomics to one address."""


@wp.func
def failed(diverged: wp.array[wp.int32]):
    """Whether there is anything to tell."""
    lowest = wp.min(wp.min(diverged[PARTICLE], diverged[EDGE]), wp.min(diverged[ENERGY], diverged[PIECE]))
    return lowest < NOTHING or diverged[CONTACTS] > 0


@step_pass
def check_stretch(
    k: wp.int32,
    # Model:
    edge: wp.array[wp.vec2i],  # [edge_count]
    rest_length: wp.array[Real],  # [edge_count] [m]
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    # In:
    limit: Real,  # length over rest length, squared
    # Out:
    diverged: wp.array[wp.int32],  # [5]
):
    rest = rest_length[k]
    d = x[index(edge[k][0])] - x[index(edge[k][1])]
    # Squares: a root a link would cost as much as all the rest.
    if wp.dot(d, d) > limit * (rest * rest) and rest > Real(0.0):
        wp.atomic_min(diverged, EDGE, k)


@step_pass
def sum_energy(
    chunk: wp.int32,
    # Model:
    gravity: Vec3,  # [m/s^2]
    mass: wp.array[Real],  # [particle_count] [kg], 0 of fixed ones
    # State:
    x: wp.array[Vec3],
    v: wp.array[Vec3],
    # Out:
    energy: wp.array[wp.float64],  # [1] added to: kinetic and in gravity [J]
):
    first = chunk * CHUNK
    total = Real(0.0)
    for i in range(first, wp.min(first + CHUNK, x.shape[0])):
        v_i = v[i]
        total = total + mass[i] * (Real(0.5) * wp.dot(v_i, v_i) - wp.dot(gravity, x[i]))
    wp.atomic_add(energy, 0, wp.float64(total))


@step_pass
def check_energy(
    i: wp.int32,
    # In:
    limit: wp.float64,  # [J]
    # Out:
    energy: wp.array[wp.float64],  # [1] set to zero for the next frame
    diverged: wp.array[wp.int32],
):
    if energy[0] > limit:
        diverged[ENERGY] = 0
    energy[0] = wp.float64(0.0)
