"""From which side links pushed each other in the step before, looked up by pair in a hash table."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.precision import Real, Vec3, func, kernel


@wp.func
def hashed(pair: wp.vec2i, room: wp.int32):
    """Where a pair is looked for first in a table with room for a power of two."""
    mixed = wp.uint32(pair[0]) * wp.uint32(73856093) + wp.uint32(pair[1]) * wp.uint32(19349663)
    mixed = (mixed ^ (mixed >> wp.uint32(15))) * wp.uint32(83492791)
    return wp.int32((mixed ^ (mixed >> wp.uint32(13))) & wp.uint32(room - 1))


@kernel
def remember_contacts(
    # In:
    count: wp.array[wp.int32],  # [1]
    pair: wp.array[wp.vec2i],  # [capacity]
    normal: wp.array[Vec3],  # [capacity]
    lam: wp.array[Real],  # [capacity]
    # Out:
    table: wp.array[wp.int32],  # [power of two] zero before: 1 + contact, at the place of its pair or after it
    pair_before: wp.array[wp.vec2i],  # [capacity]
    normal_before: wp.array[Vec3],  # [capacity]
):
    """The sides of those that pushed: a pair that sweeps left deep inside each other keeps the one that it has."""
    k = wp.tid()
    if k >= count[0] or lam[k] <= Real(0.0):
        return
    pair_before[k] = pair[k]
    normal_before[k] = normal[k]
    at = hashed(pair[k], table.shape[0])
    while wp.atomic_cas(table, at, 0, k + 1) != 0:
        at = (at + 1) % table.shape[0]


@func
def keep_side(
    n: Vec3,
    pair: wp.vec2i,
    table: wp.array[wp.int32],
    pair_before: wp.array[wp.vec2i],
    normal_before: wp.array[Vec3],
):
    """n, or its opposite where the pair pushed each other the other way in the step before: then it has crossed."""
    at = hashed(pair, table.shape[0])
    k = table[at]
    while k > 0:
        before = pair_before[k - 1]
        if before[0] == pair[0] and before[1] == pair[1]:
            if wp.dot(n, normal_before[k - 1]) < Real(-0.5):
                return -n
            return n
        at = (at + 1) % table.shape[0]
        k = table[at]
    return n
