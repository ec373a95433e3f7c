"""Contacts of two free particles (contact.py) as weighted ones (weighted.py)."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.pieces import Particles
from pbd_warp.kernels.precision import Real, Vec3, kernel
from pbd_warp.kernels.touch import double, gap_now
from pbd_warp.kernels.weighted import NOBODY, Contacts, Memory, add_contact, displacement, turn_contact


@wp.struct
class Pairs:
    """Pairs of particles among the contacts found."""

    place: wp.array[wp.int32]  # [capacity] among the weighted contacts, -1: none of these
    side: wp.array[wp.vec3d]  # [capacity] normal where the path came in, or at the start
    start: wp.array[wp.vec3d]  # [capacity] from the second to the first particle [m]
    surface: wp.array[wp.vec4d]  # [capacity] gap at the start along `side`, distance kept [m]


@kernel
def list_pairs(
    # Model:
    radius: wp.array[Real],  # [particle_count] [m]
    friction: Real,
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    count: wp.array[wp.int32],  # [1]
    pair: wp.array[wp.vec2i],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
    gap: wp.array[Real],  # [capacity]
    lam_scale: wp.float64,
    round_off: wp.float64,  # of positions, relative
    memory: Memory,
    # Out:
    pairs: Pairs,
    c: Contacts,
):
    """Those that touch.py leaves: both particles free."""
    k = wp.tid()
    pairs.place[k] = NOBODY
    if k >= wp.min(count[0], pair.shape[0]) or pair[k][1] < 0:
        return
    i = wp.min(pair[k][0], pair[k][1])
    j = wp.max(pair[k][0], pair[k][1])
    if w[i] == Real(0.0) or w[j] == Real(0.0):
        return
    n = double(normal[k])
    if i != pair[k][0]:
        n = -n
    away = double(x[i]) - double(x[j])
    kept = wp.float64(radius[i]) + wp.float64(radius[j]) - wp.float64(gap[k])
    if wp.dot(n, n) > wp.float64(0.0):
        kept = wp.dot(n, away) - wp.float64(gap[k])
    elif wp.length(away) > wp.float64(0.0):
        n = wp.normalize(away)
    else:
        n = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    pairs.side[k] = n
    pairs.start[k] = away
    pairs.surface[k] = wp.vec4d(wp.dot(n, away) - kept, kept, wp.float64(0.0), wp.float64(0.0))
    size = wp.float64(radius[i]) + wp.float64(radius[j])
    rounding = round_off * wp.max(wp.length(double(x[i])), wp.length(double(x[j])))
    pairs.place[k] = add_contact(
        c, memory, wp.vec4i(i, j, NOBODY, NOBODY), wp.float64(friction), size, rounding, n, lam_scale
    )


@kernel
def follow_pairs(
    # In:
    tile: wp.array[wp.int32],  # [particle_count]
    p: Particles,
    pairs: Pairs,
    # Out:
    c: Contacts,
):
    """Gaps and normals as the particles are now."""
    k = wp.tid()
    q = pairs.place[k]
    if q < 0:
        return
    zero = wp.vec3d()
    away = displacement(c.member[q][0], tile, p, zero) - displacement(c.member[q][1], tile, p, zero)
    gap, n, curvature = gap_now(away, pairs.side[k], pairs.start[k], zero, pairs.surface[k])
    one = wp.float64(1.0)
    turn_contact(c, q, wp.vec4d(one, -one, wp.float64(0.0), wp.float64(0.0)), n, gap, away, zero)


@kernel
def note_pairs(
    # In:
    pairs: Pairs,
    c: Contacts,
    # Out:
    lam: wp.array[Real],  # [capacity] for line 16
):
    k = wp.tid()
    q = pairs.place[k]
    if q >= 0:
        lam[k] = Real(wp.dot(c.force[q], c.normal[q]))
