"""Forces of contacts between pieces (coupled.py): projected sweeps over all of them, and what is left of them."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.pieces import Particles, Progress, Schedule
from pbd_warp.kernels.ports import Ports, away_at_ports, own_response, push_ports
from pbd_warp.kernels.precision import kernel
from pbd_warp.kernels.weighted import Contacts

GIVES = wp.constant(0.1)
"""Of what a contact's force moves: what it gives in the first iteration."""

SWEEPS = wp.constant(500)
"""In one iteration, at most."""

CLOSER = wp.constant(1.0e-4)
"""Of the first sweep's change: where the sweeps of an iteration end. The next one has other normals anyway."""


@wp.func
def widest_response(R: wp.mat33d, n: wp.vec3d):
    """The largest that a force across n moves across n: of R's symmetric part there."""
    one = wp.float64(1.0)
    a = wp.vec3d(one, wp.float64(0.0), wp.float64(0.0))
    if wp.abs(n[0]) > wp.float64(0.7):
        a = wp.vec3d(wp.float64(0.0), one, wp.float64(0.0))
    a = wp.normalize(wp.cross(n, a))
    b = wp.cross(n, a)
    aa = wp.dot(a, R * a)
    bb = wp.dot(b, R * b)
    half = wp.float64(0.5)
    ab = half * (wp.dot(a, R * b) + wp.dot(b, R * a))
    return half * (aa + bb) + wp.sqrt(half * half * (aa - bb) * (aa - bb) + ab * ab)


@kernel
def sweep_contacts(
    # In:
    s: Schedule,
    progress: wp.array[wp.float64],  # [2] iterations made, what is left of contacts over what is tolerated
    tolerance: wp.float64,  # [m]
    relative: wp.float64,
    # Scratch and out:
    ports: Ports,
    c: Contacts,
):
    """Forces that make the step obey contacts and friction to first order; one thread."""
    zero = wp.float64(0.0)
    count = wp.min(c.count[0], c.member.shape[0])
    gives = wp.float64(GIVES) * wp.pow(wp.float64(0.1), progress[0])
    for k in range(count):
        c.response[k] = own_response(k, s, ports, c)
        c.before[k] = c.force[k]
        c.way[k] = wp.vec3d()
    first = zero
    before = zero
    going = bool(True)
    sweep = int(0)
    while going:
        widest = zero
        slope = zero
        for k in range(count):
            n = c.normal[k]
            R = c.response[k]
            across_n = wp.dot(n, R * n)
            if across_n > zero:
                force = c.force[k]
                away = away_at_ports(k, ports, c)
                push = wp.dot(n, force)
                C = c.gap[k] + wp.dot(n, away) + gives * across_n * (push - wp.dot(n, c.before[k]))
                new_push = wp.max(push - C / (across_n * (wp.float64(1.0) + gives)), zero)
                new = new_push * n
                mu = c.friction[k]
                if mu > zero and new_push > zero:
                    slip = away + R * ((new_push - push) * n)
                    hold = force - push * n
                    had = c.before[k] - wp.dot(n, c.before[k]) * n
                    wide = widest_response(R, n)
                    give = gives * wide
                    slip = slip - wp.dot(n, slip) * n + give * (hold - had)
                    hold = hold - slip / (wide + give)
                    held = wp.length(hold)
                    if held > mu * new_push:
                        hold = (mu * new_push / held) * hold
                    new = new + hold
                change = new - force
                c.change[k] = change
                c.force[k] = new
                push_ports(k, change, s, ports, c)
                size = wp.length(change)
                tolerated = tolerance + c.rounding[k] + relative * (c.size[k] + across_n * wp.length(new))
                widest = wp.max(widest, across_n * size / tolerated)
                slope = slope + across_n * size * size
        sweep = sweep + 1
        if sweep == 1:
            first = widest
        going = sweep < SWEEPS and widest > wp.max(wp.float64(0.1), wp.float64(CLOSER) * first)
        if going:
            factor = zero
            if before > zero and slope < before:
                factor = slope / before
            for k in range(count):
                if factor > zero:
                    along = factor * c.way[k]
                    c.force[k] = c.force[k] + along
                    push_ports(k, along, s, ports, c)
                    c.way[k] = along + c.change[k]
                else:
                    c.way[k] = c.change[k]
            before = slope
    for k in range(count):
        for m in range(4):
            port = c.port[k][m]
            if port >= 0:
                ports.load[port] = ports.load[port] + c.weight[k][m] * (c.force[k] - c.before[k])


@wp.func
def contact_error(k: wp.int32, p: Particles, ports: Ports, c: Contacts, tolerance: wp.float64, relative: wp.float64):
    """What is left of gap, friction and balance over what is tolerated."""
    zero = wp.float64(0.0)
    away = c.carried[k]
    weight = zero
    for m in range(4):
        port = c.port[k][m]
        if port >= 0:
            t = ports.to_tile[port]
            away = away + c.weight[k][m] * p.move[t]
            weight = weight + c.weight[k][m] * c.weight[k][m] * p.weight[t]
    n = c.normal[k]
    force = c.force[k]
    push = wp.dot(n, force)
    gap = c.gap[k] + wp.dot(n, away)
    tolerated = tolerance + c.rounding[k] + relative * (c.size[k] + weight * wp.length(force))
    if push <= zero:
        return wp.max(-gap, zero) / tolerated
    left = wp.abs(gap) + weight * c.turned[k]
    mu = c.friction[k]
    if mu > zero:
        slip = away - wp.dot(n, away) * n
        hold = force - push * n
        held = wp.length(hold)
        off = wp.length(slip)
        if held > wp.float64(0.999999999) * mu * push:  # at the cone: only slip along the friction is wrong
            off = wp.length(slip + (wp.length(slip) / held) * hold)
        left = left + off
    return left / tolerated


@kernel
def judge_contacts(
    # In:
    p: Particles,
    ports: Ports,
    c: Contacts,
    pieces: wp.array[Progress],
    iterations: wp.int32,
    tolerance: wp.float64,
    relative: wp.float64,
    # Out:
    progress: wp.array[wp.float64],
    going: wp.array[wp.int32],  # [1] 1: another iteration
):
    """One thread: whether all pieces and contacts have arrived."""
    left = wp.float64(0.0)
    for k in range(wp.min(c.count[0], c.member.shape[0])):
        left = wp.max(left, contact_error(k, p, ports, c, tolerance, relative))
    done = bool(left <= wp.float64(1.0))
    for piece in range(pieces.shape[0]):
        if ports.coupled[piece] == 1:
            done = done and pieces[piece].done
    progress[0] = progress[0] + wp.float64(1.0)
    progress[1] = left
    going[0] = wp.where(done or int(progress[0]) >= iterations, 0, 1)
