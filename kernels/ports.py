"""Particles that contacts between pieces touch, and what forces on them move (coupled.py)."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.divergence import CONTACTS
from pbd_warp.kernels.pieces import Schedule
from pbd_warp.kernels.precision import kernel
from pbd_warp.kernels.weighted import NOBODY, Contacts


@wp.struct
class Ports:
    """Particles that contacts touch. The ports of a piece have the numbers of its first tiles."""

    piece: wp.array[wp.int32]  # [tile_count] piece of each tile
    tile: wp.array[wp.int32]  # [particle_count] tile of each particle, -1: none
    of_tile: wp.array[wp.int32]  # [tile_count] -1: not touched
    to_tile: wp.array[wp.int32]  # [tile_count] of each port
    count: wp.array[wp.int32]  # [piece_count] ports of a piece
    coupled: wp.array[wp.int32]  # [piece_count] 1: has any
    first: wp.array[wp.int32]  # [piece_count] where its ports' responses begin
    used: wp.array[wp.int32]  # [1] responses of all pieces, may exceed their room
    response: wp.array[wp.mat33d]  # [room] K^-1 at the ports, row by row [1/kg]
    column: wp.array[wp.mat33d]  # [tile_count] one column of K^-1
    y: wp.array[wp.vec3d]  # [tile_count] one solution
    move: wp.array[wp.vec3d]  # [tile_count] displacement of each port after the step [m]
    stiffness: wp.array[wp.float64]  # [tile_count] of the contacts of each port, as `find_stiffness` has it [kg]
    load: wp.array[wp.vec3d]  # [tile_count] change of the force on each port [kg m]


@kernel
def clear_ports(
    # Out:
    ports: Ports,
):
    t = wp.tid()
    ports.of_tile[t] = NOBODY
    ports.load[t] = wp.vec3d()
    ports.stiffness[t] = wp.float64(0.0)


@kernel
def mark_ports(
    # In:
    c: Contacts,
    # Out:
    ports: Ports,
):
    k = wp.tid()
    if k < wp.min(c.count[0], c.member.shape[0]):
        for m in range(4):
            i = c.member[k][m]
            if i >= 0:
                t = ports.tile[i]
                if t >= 0:
                    ports.of_tile[t] = 1


@kernel
def number_ports(
    # In:
    s: Schedule,
    # Out:
    ports: Ports,
    diverged: wp.array[wp.int32],  # [5]
):
    piece = wp.tid()
    begin = s.piece_first[piece]
    port = int(begin)
    for t in range(begin, s.piece_first[piece + 1]):
        if ports.of_tile[t] >= 0:
            ports.of_tile[t] = port
            ports.to_tile[port] = t
            port = port + 1
    number = port - begin
    first = wp.atomic_add(ports.used, 0, number * number)
    if first + number * number > ports.response.shape[0]:
        diverged[CONTACTS] = -number
        number = 0
    ports.first[piece] = first
    ports.count[piece] = number
    ports.coupled[piece] = wp.min(number, 1)


@kernel
def find_ports(
    # In:
    ports: Ports,
    # Out:
    c: Contacts,
):
    """Of the contacts' members."""
    k = wp.tid()
    if k < wp.min(c.count[0], c.member.shape[0]):
        found = wp.vec4i(NOBODY, NOBODY, NOBODY, NOBODY)
        for m in range(4):
            i = c.member[k][m]
            if i >= 0:
                t = ports.tile[i]
                if t >= 0:
                    if ports.coupled[ports.piece[t]] == 1:
                        found[m] = ports.of_tile[t]
        c.port[k] = found


@wp.func
def response_of(a: wp.int32, b: wp.int32, s: Schedule, ports: Ports):
    """What a force at port b moves at port a."""
    piece = ports.piece[b]
    begin = s.piece_first[piece]
    if a < begin or a >= s.piece_first[piece + 1]:
        return wp.mat33d()
    return ports.response[ports.first[piece] + (a - begin) * ports.count[piece] + b - begin]


@wp.func
def own_response(k: wp.int32, s: Schedule, ports: Ports, c: Contacts):
    """W's block of contact k with itself."""
    R = wp.mat33d()
    port = c.port[k]
    weight = c.weight[k]
    for a in range(4):
        if port[a] >= 0:
            for b in range(4):
                if port[b] >= 0:
                    R = R + (weight[a] * weight[b]) * response_of(port[a], port[b], s, ports)
    return R


@wp.func
def push_ports(k: wp.int32, force: wp.vec3d, s: Schedule, ports: Ports, c: Contacts):
    """What a change of contact k's force does to all ports of its members' pieces."""
    port = c.port[k]
    weight = c.weight[k]
    for m in range(4):
        b = port[m]
        if b >= 0:
            f = weight[m] * force
            piece = ports.piece[b]
            begin = s.piece_first[piece]
            number = ports.count[piece]
            place = ports.first[piece] + b - begin
            for a in range(number):
                ports.move[begin + a] = ports.move[begin + a] + ports.response[place + a * number] * f


@wp.func
def away_at_ports(k: wp.int32, ports: Ports, c: Contacts):
    """`away` of contact k after the step."""
    away = c.carried[k]
    port = c.port[k]
    weight = c.weight[k]
    for m in range(4):
        if port[m] >= 0:
            away = away + weight[m] * ports.move[port[m]]
    return away
