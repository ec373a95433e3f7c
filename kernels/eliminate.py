"""The matrix of a piece in Newton's method (newton.py), with what resists bending, and its elimination."""

from __future__ import annotations

import warp as wp

from pbd_warp.kernels.bending_row import bending_pass, limit_pushes, positive
from pbd_warp.kernels.forward import forward_pass
from pbd_warp.kernels.pieces import Bends, Links, Matrix, Particles, Points, Schedule, Touching


@wp.func
def eliminate_piece(
    piece: wp.int32,
    begin: wp.int32,
    end: wp.int32,
    s: Schedule,
    m: Matrix,
    p: Particles,
    links: Links,
    points: Points,
    c: Touching,
    bends: Bends,
    rigid: wp.bool,
    mean_gradient: wp.bool,
    short: wp.float64,
    touch: wp.float64,
    lagging: wp.bool,
):
    """Bending with its exact derivatives, and once more without them where the matrix is not positive."""
    bent = bool(False)
    if bends.first:
        bent = bends.first[piece] < bends.first[piece + 1]
        bends.exact[piece] = 1
        for t in range(begin, end):
            bends.load[t] = m.b[t]
    again = bool(True)
    while again:
        if bends.first:
            limit_pushes(s.link_first[begin], s.link_first[end], links, bends, bent and bends.exact[piece] == 1)
            bending_pass(begin, end, piece, s, m, p, bends, mean_gradient)
        forward_pass(begin, end, s, m, p, links, points, c, rigid, mean_gradient, short, touch, lagging)
        again = False
        if bent:
            if bends.exact[piece] == 1 and not positive(begin, end, m, p):
                again = True
                bends.exact[piece] = 0
                for t in range(begin, end):
                    m.b[t] = bends.load[t]
