"""Triples that resist bending: laid out for Newton's method (kernels/bending_row.py), and what is known to fail."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

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


SWEEPS_BEND = {"jacobi": 0.1, "gauss-seidel": 0.3}
"""How much stiffer than inertia, as a root, bending may be for each sweep of a step before a rod at rest sags by more
than 1 % of its size: from the map bending, where it is right but at the boundary."""


def folds(bending: BendingSet, x: np.ndarray) -> Iterator[tuple[str, float]]:
    """Links that fold back on each other have no curvature."""
    folded = bending.folded(x)
    if folded.size:
        particle = bending.triple[folded[0], 1]
        yield f"links fold back, or have no length, at particle {particle}, where bending is singular", 2.0


def softened(bending: BendingSet, method: Any, step: float, w: np.ndarray) -> Iterator[tuple[str, float]]:
    """K sweeps pass a moment on by K triples a step; what is stiffer than they can carry becomes softer."""
    if method.keeps_forces or not len(bending):
        return
    i, j, k = bending.triple.T
    stiff = step**2 * bending.stiffness / bending.length**2 * (w[i] + 4.0 * w[j] + w[k]) / bending.length
    worst = int(np.argmax(stiff))
    text = (
        f"{method.iterations} iterations in steps of {step:.3g} s are too few for a bending stiffness of "
        f"{bending.stiffness[worst]:.3g} N m^2"
    )
    yield text, float(np.sqrt(max(stiff[worst], 0.0)) / (SWEEPS_BEND[method.name] * method.iterations))
