"""A particle that is pulled towards a target: with a bounded force and at a bounded speed, so that what is in the way
or holds it wins.

    v* = (q - x) / T + dq/dt, no faster than `speed`: the velocity that takes it to where the target q is by then
    p = (v* - v) / (h w): the force that would give it that velocity within a step, were it alone
    f = s + p, no stronger than `strength`; where it is weaker than that, s += p / 8

s carries what else pulls at the particle, so that at rest it is at the target and not where a spring would hang. Of the
particle's mass m and what it drags along, M >= m, a step multiplies an error of the velocity by z, where
(z - 1)^2 + r (z - 1) + r/8 = 0 with r = m/M <= 1: |z| < 1 for every r, whatever the step.
Source: ours; a proportional-integral controller.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, step_pass


@wp.func
def bounded(vector: Any, most: Any):
    """The vector, no longer than that."""
    length = wp.length(vector)
    if length > most:
        return vector * (most / length)
    return vector


@step_pass
def pull(
    _: wp.int32,
    # State:
    x: wp.array[Vec3],  # [particle_count] [m]
    w: wp.array[Real],  # [particle_count] [1/kg]
    # In:
    particle: wp.array[wp.int32],  # [1] the one that is held, or -1
    target: wp.array[Vec3],  # [1] where the target is at the end of the frame [m]
    rate: wp.array[Vec3],  # [1] dq/dt until then [m/s]
    strength: wp.array[Real],  # [1] largest force [N]
    speed: Real,  # [m/s]
    response: Real,  # T [s]
    dt: Real,  # h, of a step [s]
    # Out:
    left: wp.array[wp.int32],  # [1] steps that the target still moves
    steady: wp.array[Vec3],  # [1] s [N]
    v: wp.array[Vec3],  # [particle_count] [m/s]
):
    """v += h w f of the held particle, at the start of a step."""
    i = particle[0]
    if i >= 0 and w[i] > Real(0.0):
        drift = Real(wp.min(left[0], 1)) * rate[0]
        place = target[0] - dt * Real(left[0]) * drift
        left[0] = wp.max(left[0] - 1, 0)
        wish = bounded((place - x[i]) / response + drift, speed)
        missing = (wish - v[i]) / (dt * w[i])
        total = steady[0] + missing
        v[i] = v[i] + dt * w[i] * bounded(total, strength[0])
        if wp.length(total) <= strength[0]:  # else s would grow while nothing can be done
            steady[0] = steady[0] + missing / Real(8.0)
