"""Discs start deep inside each other, in a heap.

Contacts that are violated from the start, no gravity. One should see the discs leave each other until they touch, and
rest; instead they leave in one step, which is a velocity that grows as the step gets shorter, and fly on.
"""

import numpy as np

import pbd_warp as pbd

RADIUS = 0.1  # m


def scene(depth: float = 0.2, discs: int = 7) -> pbd.Scene:
    """`depth` of the overlaps over the diameter: 0 they touch, 1 they are all in the same place."""
    columns = int(np.ceil(np.sqrt(discs)))
    column, row = np.arange(discs) % columns, np.arange(discs) // columns
    heap = np.stack([column + 0.5 * (row % 2), np.sqrt(0.75) * row, 0.0 * row], axis=1)
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles(2.0 * RADIUS * (1.0 - depth) * heap, mass=1.0, radius=RADIUS)
    builder.enable_contacts()
    return pbd.Scene(builder, frames=60, substeps=4, method=pbd.Jacobi(iterations=4), max_contacts=discs * discs + 64)
