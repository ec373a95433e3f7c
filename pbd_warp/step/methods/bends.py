"""Triples that resist bending, laid out for Newton's method (kernels/bending_row.py)."""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels import pieces
from pbd_warp.model.bending import BendingSet
from pbd_warp.step.context import Context
from pbd_warp.step.methods.schedule import Schedule, slots


def bind_bends(context: Context, bending: BendingSet, s: Schedule, links: pieces.Links) -> pieces.Bends:
    """The triples of which a particle is free, piece by piece; all None where there are none."""
    bends = pieces.Bends()
    if not len(bending):
        return bends
    tile = s.tile[bending.triple]
    piece_of = np.repeat(np.arange(len(s.piece_first) - 1), np.diff(s.piece_first))
    some = np.flatnonzero((tile >= 0).any(axis=1))
    piece = piece_of[tile[some].max(axis=1)]
    order = some[np.argsort(piece, kind="stable")]
    tile, triple = tile[order], bending.triple[order]
    first = np.concatenate([[0], np.cumsum(np.bincount(piece, minlength=len(s.piece_first) - 1))])
    i, j, k = tile.T
    meet = np.stack([slots(s, i, j), slots(s, j, k), slots(s, i, k)], axis=1)
    shape = np.stack([bending.stiffness / bending.length, bending.length, bending.rest], axis=1)[order]
    bends.first = context.upload("direct.bend_first", first, wp.int32)
    bends.particle = context.upload("direct.bend_particle", triple, wp.vec3i)
    bends.tile = context.upload("direct.bend_tile", tile, wp.vec3i)
    bends.slot = context.upload("direct.bend_slot", meet, wp.vec3i)
    bends.shape = context.upload("direct.bend_shape", shape, wp.vec3d)
    for name in ("before1", "before2", "start1", "start2"):
        setattr(bends, name, context.allocate(f"direct.bend_{name}", len(triple), wp.vec3d))
    pieces_ = len(s.piece_first) - 1
    for name, size, dtype in (
        ("scale", pieces_, wp.float64),
        ("exact", pieces_, wp.int32),
        ("load", len(s.particle), wp.vec3d),
    ):
        setattr(bends, name, context.allocate(f"direct.bend_{name}", size, dtype))
    bends.softest = context.upload("direct.bend_softest", links.softest.numpy(), wp.float64)
    return bends
