"""Links against colliders: a link is kept off what its ends pass on either side.

The ends themselves are kept off by collider.py, and with them, where a surface is flat, all between. On a sphere the
link's own closest point can be nearer: a weighted contact (link_contact.py) of both ends, where the link comes in.
A sphere is a capsule without length (capsule.py).
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.capsule import meet
from pbd_warp.kernels.contact import limit_overlap
from pbd_warp.kernels.precision import Real, Vec3, Vec4, kernel
from pbd_warp.kernels.shapes import SPHERE


@kernel
def find_link_collider_contacts(
    # Model:
    number: wp.array[wp.int32],  # [collider_count] among all colliders
    kind: wp.array[wp.int32],  # [collider_count] PLANE or SPHERE
    centre: wp.array[Vec3],  # [collider_count] [m]
    plane_normal: wp.array[Vec3],  # [collider_count]
    size: wp.array[Real],  # [collider_count] a sphere's radius [m]
    link: wp.array[wp.vec2i],  # [link_count]
    radius: wp.array[Real],  # [particle_count] [m]
    margin: Real,  # watched beyond touching, relative to the link's radius
    depenetration: Real,  # overlap that a step takes back at most [m]; negative: all of it
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    u: wp.array[Vec3],
    # Out:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],  # (link, -1 - collider)
    member: wp.array[wp.vec4i],
    weight: wp.array[Vec4],
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    valence: wp.array[wp.int32],
):
    """Line 8 for links and colliders; where the closest point is an end, that particle's own contact serves."""
    e = wp.tid()
    i = link[e][0]
    j = link[e][1]
    if w[i] + w[j] == Real(0.0):
        return
    d = x[j] - x[i]
    reach = margin * wp.max(radius[i], radius[j]) + wp.max(wp.length(u[i]), wp.length(u[j]))
    for c in range(kind.shape[0]):
        if kind[c] == SPHERE:
            away = x[i] - centre[c]
            near, s, t, n = meet(
                away,
                d,
                Vec3(),
                u[i],
                u[j] - u[i],
                Vec3(),
                radius[i],
                radius[j],
                size[c],
                size[c],
            )
            if near < reach and s > Real(0.0) and s < Real(1.0):
                k = wp.atomic_add(count, 0, 1)
                if k < pair.shape[0]:
                    rest = radius[i] + s * (radius[j] - radius[i]) + size[c]
                    pair[k] = wp.vec2i(e, -1 - number[c])
                    member[k] = wp.vec4i(i, j, -1, -1)
                    weight[k] = Vec4(Real(1.0) - s, s, Real(0.0), Real(0.0))
                    normal[k] = n
                    gap[k] = limit_overlap(wp.dot(n, away + s * d) - rest, depenetration)
                    wp.atomic_add(valence, i, 1)
                    wp.atomic_add(valence, j, 1)
