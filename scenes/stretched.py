"""A rope is pulled far beyond its length, held, and let go.

Distance constraints that nothing can satisfy, no gravity. One should see all links stretch alike while the grabber
holds the end (the two at the ends half as much: only one of their particles is free), and the rope come back to its
length without flying apart when the grabber lets go.
"""

import numpy as np

import pbd_warp as pbd

LENGTH = 1.0  # m
PULLED, HELD = 0.5, 1.0  # s: from when the grabber has arrived, to when it lets go


def scene(factor: float = 1.5, links: int = 10) -> pbd.Scene:
    """`factor`: how far apart the ends are held, over the rope's length."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    rope = builder.add_rope(np.linspace([0.0, 0, 0], [LENGTH, 0, 0], links + 1), mass=0.5, radius=0.02)
    drag = [(0.0, "select", rope[-1]), (PULLED, "move", (factor * LENGTH, 0.0, 0.0)), (HELD, "deselect")]
    return pbd.Scene(builder, frames=150, substeps=4, method=pbd.Jacobi(iterations=20), damping=0.5, drag=drag)
