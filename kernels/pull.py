"""A particle that is pulled towards a target: with a bounded force and at a bounded speed, so that what is in the way
or holds it wins.

    v* = (target - x) / T, no faster than `speed`: the velocity that would take it there
    p = (v* - v) / (h w): the force that would give it that velocity within a step, were it alone
    f = s + p, no stronger than `strength`; s += p / 8, likewise bounded

s carries what else pulls at the particle, so that at rest it is at the target and not where a spring would hang. Of the
particle's mass m and what it drags along, M >= m, a step multiplies an error of the velocity by z, where
(z - 1)^2 + r (z - 1) + r/8 = 0 with r = m/M <= 1: |z| < 1 for every r, whatever the step.
Source: ours; a proportional-integral controller.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, kernel


@wp.func
def bounded(vector: Any, most: Any):
    """The vector, no longer than that."""
    length = wp.length(vector)
    if length > most:
        return vector * (most / length)
    return vector


@kernel
def pull(
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    particle: wp.array[wp.int32],  # [1] the one that is held, or -1
    target: wp.array[Vec3],  # [1] [m]
    strength: wp.array[Real],  # [1] largest force [N]
    speed: Real,  # [m/s]
    response: Real,  # T [s]
    dt: Real,  # h, of a step [s]
    # Out:
    steady: wp.array[Vec3],  # [1] s [N]
    v: wp.array[Vec3],  # [particle_count] [m/s]
):
    """v += h w f of the held particle, at the start of a step."""
    i = particle[0]
    if i >= 0 and w[i] > Real(0.0):
        wish = bounded((target[0] - x[i]) / response, speed)
        missing = (wish - v[i]) / (dt * w[i])
        v[i] = v[i] + dt * w[i] * bounded(steady[0] + missing, strength[0])
        steady[0] = bounded(steady[0] + missing / Real(8.0), strength[0])
