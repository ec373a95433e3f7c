"""Contacts between links: C(u) = gap + n . sum_m a_m u_m >= 0, over the two ends of either link.

A contact is found as two capsules come near each other on the way x -> x + u (capsule.py), and stays the half-space of
that moment: along n, between the points that were closest, whose barycentric weights a_m are positive on the first link
and negative on the second. gap = n . sum_m a_m x_m - rest, rest the sum of the radii there.
A particle that no link has is a capsule without length; where a closest point is an end, only that end takes part.

    members  up to four particles, -1 where there is none; the first side's, then the second's
    weights  a_m, each side's sum up to 1 and -1; 0 where there is none

It is projected as every inequality of contact.py: dlam = max(-lam, -C / sum_m n_m w_m a_m^2), friction bounded by
mu lam for the slip, which is the tangential part of sum_m a_m u_m. Every force acts on both links with one sum of zero
and, at points n apart, without a torque but that of friction.
Source: Mueller et al. 2007, section 3.4, for two segments; ours.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.contact import friction_of
from pbd_warp.kernels.precision import Real, Vec3, Vec4, kernel


@kernel
def project_link_contact(
    # Model:
    friction: Real,  # of links with each other
    collider_friction: wp.array[Real],  # [collider_count]
    # State:
    w: wp.array[Real],
    # In:
    count: wp.array[wp.int32],
    pair: wp.array[wp.vec2i],
    member: wp.array[wp.vec4i],
    weight: wp.array[Vec4],
    normal: wp.array[Vec3],
    gap: wp.array[Real],
    u: wp.array[Vec3],
    valence: wp.array[wp.int32],  # or None: masses are not split
    relaxation: Real,
    # Out:
    lam: wp.array[Real],  # [capacity] >= 0 [kg m]
    lam_friction: wp.array[Vec3],  # [capacity] [kg m], or None: no contact has friction
    residual: wp.array[Real],  # [1] deepest overlap [m], or None: not wanted
    correction: wp.array[Vec3],
):
    """Line 10: dlam = max(-lam, -C / sum_m n_m w_m a_m^2), and what friction holds of the slip."""
    k = wp.tid()
    if k >= count[0]:
        return
    taking = member[k]
    share = weight[k]
    inverse_mass = Real(0.0)
    move = Vec3()
    for m in range(4):
        i = taking[m]
        if i >= 0:
            move = move + share[m] * u[i]
            split = w[i] * share[m] * share[m]
            if valence:
                split = split * Real(valence[i])
            inverse_mass = inverse_mass + split
    if inverse_mass == Real(0.0):
        return
    n = normal[k]
    c = wp.dot(n, move) + gap[k]
    if residual:
        wp.atomic_max(residual, 0, -c)
    dlam = wp.max(-lam[k], -relaxation * c / inverse_mass)
    lam[k] = lam[k] + dlam
    push = dlam * n
    if lam_friction:
        slip = move - wp.dot(n, move) * n
        hold = lam_friction[k] - slip * (relaxation / inverse_mass)
        bound = friction_of(pair[k][1], friction, collider_friction) * lam[k]
        size = wp.length(hold)
        if size > bound:
            hold = hold * (bound / size)
        push = push + (hold - lam_friction[k])
        lam_friction[k] = hold
    for m in range(4):
        i = taking[m]
        if i >= 0:
            wp.atomic_add(correction, i, (w[i] * share[m]) * push)
