"""Contacts between particles: the inequality C(p_i, p_j) = |p_i - p_j| - (r_i + r_j) >= 0.

Source: Mueller et al. 2007, section 3.4 (line 8, x -> p: entry point where the path comes in, closest point
otherwise); accumulated multipliers lam >= 0 (projected Jacobi, as in Tonge et al.
2012): a contact may take back what it pushed too far, and never pulls.

A contact is one of two, chosen when it is found:
    round       normal = 0:  C = |(x_i - x_j) + (u_i - u_j)| - (r_i + r_j) + gap,   gap = 0
    half-space  normal = n:  C = n . (u_i - u_j) + gap,   gap = n . (x_i - x_j) - (r_i + r_j)
Round is the general one. A pair that has passed through each other at the end of the step is no longer in
contact by distance; for it n, the direction at the entry point, remembers the side it came from.
With a depenetration speed a step takes back no more than `depenetration` of the overlap d that it begins with: round
ones get gap = max(d - depenetration, 0), half-spaces gap >= -depenetration.
A collider (see collider.py and shape_contact.py) is always a half-space, with j = -1 - collider and w_j = 0.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from pbd_warp.kernels.distance import distance
from pbd_warp.kernels.divergence import CONTACTS
from pbd_warp.kernels.precision import Real, Vec3, func, index, kernel, step_pass


@step_pass
def sweep_midpoints(
    i: wp.int32,
    # In:
    x: wp.array[Vec3],  # [particle_count] [m]
    u: wp.array[Vec3],  # [particle_count] [m]
    # Out:
    midpoint: wp.array[Vec3],  # [particle_count] of the path x -> p [m]
    sweep: wp.array[Real],  # [particle_count] its length [m]
):
    midpoint[i] = x[i] + Real(0.5) * u[i]
    sweep[i] = wp.length(u[i])


@wp.func
def joined(start: wp.array[wp.int32], neighbour: wp.array[wp.int32], i: wp.int32, j: wp.int32):
    """Whether j is a neighbour of i, and such a pair need not be kept apart: particles that a distance joins, which
    keeps it, or links near each other along a rope."""
    if start:
        for k in range(start[i], start[i + 1]):
            if neighbour[k] == j:
                return True
    return False


@wp.func
def limit_overlap(gap: Any, depenetration: Any):
    """A half-space's gap with no more overlap than a step may take back; without a limit where that is negative."""
    if depenetration >= type(gap)(0.0):
        return wp.max(gap, -depenetration)
    return gap


@func
def check_pair(
    i: wp.int32,
    j: wp.int32,
    # Model:
    radius: wp.array[Real],
    grown: Real,  # watched distance over r_i + r_j
    depenetration: Real,
    neighbour_start: wp.array[wp.int32],
    neighbour: wp.array[wp.int32],
    # State:
    x: wp.array[Vec3],
    # In:
    u: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    valence: wp.array[wp.int32],
):
    """Notes the pair as a contact where the paths x -> p come close; arguments as below."""
    rest = radius[i] + radius[j]
    start = x[i] - x[j]
    move = u[i] - u[j]
    end = start + move
    a = wp.dot(move, move)
    b = wp.dot(start, move)
    closest = Real(0.0)
    if a > Real(0.0):
        closest = wp.clamp(-b / a, Real(0.0), Real(1.0))
    near = wp.length(start + closest * move) < grown * rest
    if near and not joined(neighbour_start, neighbour, i, j):
        n = Vec3()
        c = wp.dot(start, start) - rest * rest
        discriminant = b * b - a * c
        if b < Real(0.0) and discriminant > Real(0.0):
            # Where they first touch: the smaller root without cancellation; inside already, the start.
            entry = wp.max(c / (wp.sqrt(discriminant) - b), Real(0.0))
            side = wp.normalize(start + entry * move)
            passed = wp.dot(end, side) <= Real(0.0) or wp.length(end) >= rest
            if entry <= Real(1.0) and passed:
                n = side
        k = wp.atomic_add(count, 0, 1)
        if k < pair.shape[0]:
            pair[k] = wp.vec2i(i, j)
            normal[k] = n
            if wp.dot(n, n) > Real(0.0):
                gap[k] = limit_overlap(wp.dot(n, start) - rest, depenetration)
            elif depenetration >= Real(0.0):
                gap[k] = wp.max(rest - wp.length(start) - depenetration, Real(0.0))
            else:
                gap[k] = Real(0.0)
            wp.atomic_add(valence, i, 1)
            wp.atomic_add(valence, j, 1)


@kernel
def find_contacts(
    # Model:
    grid: wp.uint64,  # HashGrid over the midpoints
    radius: wp.array[Real],  # [particle_count] [m]
    max_radius: Real,  # [m]
    margin: Real,  # watched beyond touching, relative to r_i + r_j
    depenetration: Real,  # overlap that a step takes back at most [m]; negative: all of it
    neighbour_start: wp.array[wp.int32],  # [particle_count + 1], or None: no pair is joined
    neighbour: wp.array[wp.int32],  # [2 edge_count]
    copy_size: wp.int32,  # particles of one copy of a replicated model: no pair is of two
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    midpoint: wp.array[Vec3],
    sweep: wp.array[Real],
    # Out:
    count: wp.array[wp.int32],  # [1] contacts found, may exceed the capacity
    pair: wp.array[wp.vec2i],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
    gap: wp.array[Real],  # [capacity] [m]
    valence: wp.array[wp.int32],  # [particle_count]
):
    """Line 8: pairs whose paths x -> p come within (1 + margin)(r_i + r_j) of each other, each found once.

    The particle with the longer path looks for the other, so its own path bounds the search:
    |m_i - m_j| <= |u_i|/2 + |u_j|/2 + r_i + r_j <= |u_i| + r_i + r_j between the midpoints m.
    One bullet thus widens its own search and nobody else's.
    """
    i = wp.hash_grid_point_id(grid, wp.tid())
    grown = Real(1.0) + margin
    reach = sweep[i] + grown * (radius[i] + max_radius)
    for j in wp.hash_grid_query(grid, midpoint[i], reach):
        looks = sweep[i] > sweep[j] or (sweep[i] == sweep[j] and i < j)
        looks = looks and i // copy_size == j // copy_size
        if looks and radius[i] + radius[j] > Real(0.0) and w[i] + w[j] > Real(0.0):
            check_pair(
                i, j, radius, grown, depenetration, neighbour_start, neighbour, x, u, count, pair, normal, gap, valence
            )


@step_pass
def find_close_contacts(
    i: wp.int32,
    # Model:
    radius: wp.array[Real],  # [particle_count] [m]
    margin: Real,  # watched beyond touching, relative to r_i + r_j
    depenetration: Real,  # overlap that a step takes back at most [m]; negative: all of it
    neighbour_start: wp.array[wp.int32],  # [particle_count + 1], or None: no pair is joined
    neighbour: wp.array[wp.int32],  # [2 edge_count]
    copy_size: wp.int32,  # particles of one copy of a replicated model
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],  # [1] contacts found, may exceed the capacity
    pair: wp.array[wp.vec2i],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
    gap: wp.array[Real],  # [capacity] [m]
    valence: wp.array[wp.int32],  # [particle_count]
):
    """Line 8 for few particles: as `find_contacts`, but each looks at all of its copy that come after it."""
    grown = Real(1.0) + margin
    middle = x[i] + Real(0.5) * u[i]
    half_path = Real(0.5) * wp.length(u[i])
    for j in range(i + 1, (i // copy_size + 1) * copy_size):
        rest = radius[i] + radius[j]
        apart = middle - (x[j] + Real(0.5) * u[j])
        reach = half_path + Real(0.5) * wp.length(u[j]) + grown * rest
        if wp.dot(apart, apart) <= reach * reach and rest > Real(0.0) and w[i] + w[j] > Real(0.0):
            check_pair(
                i, j, radius, grown, depenetration, neighbour_start, neighbour, x, u, count, pair, normal, gap, valence
            )


@step_pass
def note_overflow(
    i: wp.int32,
    # In:
    count: wp.array[wp.int32],  # [1]
    capacity: wp.int32,
    # Out:
    diverged: wp.array[wp.int32],  # [5], of divergence.py
):
    """A dropped contact is an error: remembers how many there should have been."""
    if count[0] > capacity:
        diverged[CONTACTS] = wp.max(diverged[CONTACTS], count[0])


@wp.func
def friction_of(j: wp.int32, pair_friction: Any, collider_friction: Any):
    """Coulomb's coefficient of a contact with particle j, or with collider -1 - j."""
    if j >= 0:
        return pair_friction
    return collider_friction[-1 - j]


@step_pass
def project_contact(
    k: wp.int32,
    # Model:
    radius: wp.array[Real],
    friction: Real,  # of particles with each other
    collider_friction: wp.array[Real],  # [collider_count]
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    carried: wp.array[Vec3],  # [capacity] displacement of a collider where it is touched [m], or None: none moves
    u: wp.array[Vec3],
    valence: wp.array[wp.int32],  # or None: masses are not split
    relaxation: Real,
    # Out:
    lam: wp.array[Real],  # [capacity] >= 0 [kg m]
    lam_friction: wp.array[Vec3],  # [capacity] [kg m], or None: no contact has friction
    residual: wp.array[Real],  # [1] deepest overlap [m], or None: not wanted
    correction: wp.array[Vec3],
):
    """Line 10 for contacts: dlam = max(-lam, -C / (n_i w_i + n_j w_j)).

    Friction holds the slip of the step, the tangential part of u_i - u_j (of a collider u_j is what it moves there),
    with up to mu lam (Coulomb). Here and not only in line 16, because a velocity that is stopped after the step leaves
    the slip of every step: a particle at rest on a slope would creep down it.
    """
    if k >= count[0]:
        return
    i = index(pair[k][0])
    j = pair[k][1]
    w_i = w[i]
    w_j = Real(0.0)
    move = u[i]
    if j >= 0:
        w_j = w[j]
        move = move - u[j]
    elif carried:
        move = move - carried[k]
    weight = w_i + w_j
    if valence:
        weight = Real(valence[i]) * w_i
        if j >= 0:
            weight = weight + Real(valence[j]) * w_j
    if weight == Real(0.0):
        return
    direction = normal[k]
    c = wp.dot(direction, move) + gap[k]
    if wp.dot(direction, direction) == Real(0.0):
        c, direction = distance((x[i] - x[j]) + move, radius[i] + radius[j] - gap[k])
    if residual:
        wp.atomic_max(residual, 0, -c)
    dlam = wp.max(-lam[k], -relaxation * c / weight)
    lam[k] = lam[k] + dlam
    push = dlam * direction
    if lam_friction:
        slip = move - wp.dot(direction, move) * direction
        hold = lam_friction[k] - slip * (relaxation / weight)
        bound = friction_of(j, friction, collider_friction) * lam[k]
        size = wp.length(hold)
        if size > bound:
            hold = hold * (bound / size)
        push = push + (hold - lam_friction[k])
        lam_friction[k] = hold
    wp.atomic_add(correction, i, w_i * push)
    if j >= 0:
        wp.atomic_sub(correction, j, w_j * push)
