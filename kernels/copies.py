"""Which copies of a replicated model have left what is possible in a frame: as divergence.py, a thread a copy."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.divergence import EDGE, ENERGY, NOTHING, PARTICLE
from pbd_warp.kernels.precision import Real, Vec3, index, step_pass


@step_pass
def check_copies(
    c: wp.int32,
    # Model:
    particles: wp.int32,  # of one copy
    edges: wp.int32,  # of one copy
    edge: wp.array[wp.vec2i],  # [copy_count edges]
    rest_length: wp.array[Real],  # [copy_count edges] [m]
    gravity: Vec3,  # [m/s^2]
    mass: wp.array[Real],  # [copy_count particles] [kg], 0 of fixed ones
    # State:
    x: wp.array[Vec3],
    v: wp.array[Vec3],
    # In:
    stretch_limit: Real,  # length over rest length, squared; 0: none
    energy_limit: wp.array[wp.float64],  # [copy_count] [J], or None: no limit
    # Out:
    found: wp.array[wp.vec3i],  # [copy_count] lowest particle not finite, edge stretched, 0 for energy
    diverged: wp.array[wp.int32],  # [5] first: a copy of which there is something to tell
):
    seen = wp.vec3i(NOTHING, NOTHING, NOTHING)
    energy = wp.float64(0.0)
    for k in range(particles):
        i = c * particles + k
        if not wp.isfinite(x[i]):
            seen[PARTICLE] = wp.min(seen[PARTICLE], k)
        if energy_limit:
            energy += wp.float64(mass[i] * (Real(0.5) * wp.dot(v[i], v[i]) - wp.dot(gravity, x[i])))
    if stretch_limit > Real(0.0):
        for k in range(edges):
            e = c * edges + k
            rest = rest_length[e]
            d = x[index(edge[e][0])] - x[index(edge[e][1])]
            if wp.dot(d, d) > stretch_limit * (rest * rest) and rest > Real(0.0):
                seen[EDGE] = wp.min(seen[EDGE], k)
    if energy_limit:
        if energy > energy_limit[c]:
            seen[ENERGY] = 0
    if wp.min(seen) < NOTHING:
        found[c] = seen
        wp.atomic_min(diverged, 0, c)
