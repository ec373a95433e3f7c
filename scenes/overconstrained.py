"""A bar or a loop whose every side is given several times, and which perhaps cannot close.

Distance constraints that say the same more than once, or contradict each other; no gravity. One should see a bar shrink
to its length; a loop with a side too long for the others flattens, spreads what cannot be satisfied over all sides and
rests.
"""

import numpy as np

import pbd_warp as pbd

OFF = 0.03  # of each side at the start


def scene(copies: int = 3, sides: int = 3, misfit: float = 0.2) -> pbd.Scene:
    """`copies` of each distance; `sides`: 1 a bar, 3 or more a loop; `misfit`: the last side of a loop is this part
    longer than all others together, 0: as long as the others."""
    if sides == 1:
        positions, edges, rest = np.array([[0.0, 0, 0], [1, 0, 0]]), np.array([[0, 1]]), np.ones(1)
    else:
        angle = 2.0 * np.pi * np.arange(sides) / sides
        positions = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1) / (2.0 * np.sin(np.pi / sides))
        edges = np.stack([np.arange(sides), (np.arange(sides) + 1) % sides], axis=1)
        rest = np.ones(sides)
        if misfit > 0.0:
            rest[-1] = (1.0 + misfit) * (sides - 1)
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles((1.0 + OFF) * positions, radius=0.03)
    builder.add_distances(np.tile(edges, (copies, 1)), np.tile(rest, copies))
    return pbd.Scene(builder, frames=60, method=pbd.Jacobi())
