"""Contacts between pieces that both move, inside Newton's method (newton.py): pieces iterate together.

K is the factored matrix of the pieces, s the step that they make under the contacts' forces as they are. Forces that
change by dz make the step s + K^-1 J^T dz, so with W = J K^-1 J^T the contacts of weighted.py ask of them

    0 <= push,   0 <= C(s) + (W dz)_n,   one of both 0;    |friction| <= mu push, against the slip where it slides

which projected Gauss-Seidel sweeps find, sped up like conjugate gradients (Silcowitz, Niebel, Erleben 2010). W is never
formed: of each piece what a force at one particle that is touched, a port, moves at the others is enough. Contacts may
be redundant, W singular: each gives in the first iteration, tenfold less in each that follows, and the sweeps begin at
the forces that there are.
"""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.back import back_pass
from pbd_warp.kernels.bending_row import begin_bends, bending_steps, stiffen
from pbd_warp.kernels.eliminate import eliminate_piece
from pbd_warp.kernels.elimination import back, back_tile, forward, forward_tile
from pbd_warp.kernels.link_row import SHORT
from pbd_warp.kernels.pieces import Bends, Links, Matrix, Particles, Points, Progress, Schedule, Touching
from pbd_warp.kernels.ports import Ports
from pbd_warp.kernels.precision import Real, Vec3, kernel
from pbd_warp.kernels.progress import LAG, begin_piece, end_piece, find_stiffness, first_progress, judge_piece
from pbd_warp.kernels.weighted import Contacts


@kernel
def begin_pieces(
    # Model:
    s: Schedule,
    rest_length: wp.array[Real],
    compliance: wp.array[Real],
    target: wp.array[Vec3],
    point_compliance: wp.array[Real],
    # State:
    x: wp.array[Vec3],
    w: wp.array[Real],
    # In:
    base: wp.array[Vec3],
    compliance_scale: wp.array[Real],
    lam_scale: wp.float64,
    coupled: wp.array[wp.int32],
    # Scratch and out:
    p: Particles,
    links: Links,
    points: Points,
    bends: Bends,
    u: wp.array[Vec3],
    progress: wp.array[Progress],  # [piece_count]
):
    """As solve_pieces of newton.py begins; its arguments."""
    piece = wp.tid()
    if coupled[piece] == 1:
        begin_piece(
            piece, s, rest_length, compliance, target, point_compliance, x, w, base,
            wp.float64(compliance_scale[0]), False, lam_scale, p, links, points, u,
        )  # fmt: skip
        if bends.first:
            begin_bends(piece, bends, x, u, wp.float64(compliance_scale[0]))
        progress[piece] = first_progress(p.gives[piece] == 0)


@kernel
def load_pieces(
    # In:
    p: Particles,
    ports: Ports,
    c: Contacts,
    # Out:
    m: Matrix,  # b, zero before
):
    """Forces of contacts on their members."""
    k = wp.tid()
    if k < wp.min(c.count[0], c.member.shape[0]):
        for a in range(4):
            port = c.port[k][a]
            if port >= 0:
                wp.atomic_add(m.b, ports.to_tile[port], c.weight[k][a] * c.force[k])
                across = wp.length(c.force[k]) / c.size[k]
                for b in range(4):
                    other = c.port[k][b]
                    if other >= 0 and b != a:
                        across = across + p.mass[ports.to_tile[other]]
                wp.atomic_add(ports.stiffness, port, across)


@kernel
def eliminate_pieces(
    # In:
    s: Schedule,
    # Scratch and out:
    m: Matrix,
    p: Particles,
    links: Links,
    points: Points,
    c: Touching,
    bends: Bends,
    ports: Ports,
    progress: wp.array[Progress],
):
    """The matrices' factors, the step of each port under the forces there are, and the ports' responses."""
    piece = wp.tid()
    if ports.coupled[piece] == 0:
        return
    g = progress[piece]
    g.used = g.used + 1
    progress[piece] = g
    lagging = (g.used / LAG) % 2 == 1
    begin = s.piece_first[piece]
    end = s.piece_first[piece + 1]
    number = ports.count[piece]
    short = wp.float64(SHORT) * p.mean_length[piece]
    find_stiffness(begin, end, s, p, links)
    if bends.first:
        stiffen(piece, p, bends)
    for port in range(begin, begin + number):
        t = ports.to_tile[port]
        p.stiffness[t] = p.stiffness[t] + ports.stiffness[port]
        ports.stiffness[port] = wp.float64(0.0)
    eliminate_piece(piece, begin, end, s, m, p, links, points, c, bends, g.rigid, False, short, g.touch, lagging)
    for o in range(end - begin):
        t = end - 1 - o
        z = m.b[t]
        for k in range(s.column_first[t], s.column_first[t + 1]):
            z = z - m.up[k] * ports.y[s.row[k]]
        ports.y[t] = back(m.F[t], z)
    for a in range(number):
        t = ports.to_tile[begin + a]
        ports.move[begin + a] = p.move[t] + ports.y[t]
    lowest = ports.to_tile[begin]
    for a in range(number):
        at = ports.to_tile[begin + a]
        for t in range(at, end):
            B = wp.mat33d()
            if t == at:
                B = wp.identity(3, dtype=wp.float64)
            for q in range(s.row_first[t], s.row_first[t + 1]):
                if s.row_column[q] >= at:
                    B = B - m.low[s.row_slot[q]] * ports.column[s.row_column[q]]
            if p.weight[t] == wp.float64(0.0):
                B = wp.mat33d()
            ports.column[t] = forward_tile(m.F[t], m.swap[t] * B)
        for o in range(end - lowest):
            t = end - 1 - o
            B = wp.mat33d()
            if t >= at:
                B = ports.column[t]
            for k in range(s.column_first[t], s.column_first[t + 1]):
                B = B - m.up[k] * ports.column[s.row[k]]
            ports.column[t] = back_tile(m.F[t], B)
        for b in range(number):
            ports.response[ports.first[piece] + b * number + a] = ports.column[ports.to_tile[begin + b]]


@kernel
def step_pieces(
    # In:
    s: Schedule,
    reach: wp.float64,
    tolerance: wp.float64,
    relative: wp.float64,
    close: wp.float64,
    # Scratch and out:
    m: Matrix,
    p: Particles,
    links: Links,
    points: Points,
    c: Touching,
    bends: Bends,
    ports: Ports,
    progress: wp.array[Progress],
):
    """The step under the forces found, and what it leaves."""
    piece = wp.tid()
    if ports.coupled[piece] == 0:
        return
    g = progress[piece]
    lagging = (g.used / LAG) % 2 == 1
    begin = s.piece_first[piece]
    end = s.piece_first[piece + 1]
    for t in range(begin, end):
        z = wp.vec3d()
        port = ports.of_tile[t]
        if port >= 0:
            z = ports.load[port]
            ports.load[port] = wp.vec3d()
        for q in range(s.row_first[t], s.row_first[t + 1]):
            z = z - m.low[s.row_slot[q]] * ports.y[s.row_column[q]]
        if p.weight[t] == wp.float64(0.0):
            z = wp.vec3d()
        z = forward(m.F[t], m.swap[t] * z)
        ports.y[t] = z
        m.b[t] = m.b[t] + z
    left, contact, widest, given, switched, touches = back_pass(
        begin, end, s, m, p, links, points, c, g.rigid, False, g.touch, lagging, p.mean_length[piece],
        tolerance, relative, close,
    )  # fmt: skip
    if bends.first:
        left = wp.max(left, bending_steps(piece, m, p, bends, tolerance, relative))
    progress[piece] = judge_piece(
        g, piece, begin, end, m, p, reach, lagging, left, contact, widest, given, switched, True
    )


@kernel
def begin_iterations(
    # In:
    ports: Ports,
    # Out:
    progress: wp.array[wp.float64],
    going: wp.array[wp.int32],
):
    progress[0] = wp.float64(0.0)
    progress[1] = wp.float64(0.0)
    going[0] = wp.min(ports.used[0], 1)


@kernel
def end_pieces(
    # In:
    s: Schedule,
    ports: Ports,
    pieces: wp.array[Progress],
    progress: wp.array[wp.float64],
    accepted: wp.float64,
    accepted_contact: wp.float64,
    # Out:
    p: Particles,
    links: Links,
    u: wp.array[Vec3],
    iterations_used: wp.array[wp.int32],
    unconverged: wp.array[wp.int32],
):
    """As solve_pieces of newton.py ends; besides, a solution that did not converge where the contacts did not."""
    piece = wp.tid()
    if ports.coupled[piece] == 1:
        begin = s.piece_first[piece]
        end = s.piece_first[piece + 1]
        end_piece(
            pieces[piece],
            piece,
            begin,
            end,
            s,
            p,
            links,
            False,
            accepted,
            accepted_contact,
            u,
            iterations_used,
            unconverged,
        )
    if piece == 0 and not (progress[1] <= accepted_contact):
        wp.atomic_add(unconverged, 0, 1)
