"""A rope of many links hangs straight down from a hook.

Distance constraints and gravity. One should see nothing move; iterative methods carry the weight from link to link too
slowly, so that the rope grows longer, the upper links most, with the square of their number.
"""

import numpy as np

import pbd_warp as pbd

LENGTH = 1.0  # m


def scene(links: int = 100) -> pbd.Scene:
    """`links`: how many the metre is made of."""
    positions = np.linspace([0.0, 0, 0], [0, -LENGTH, 0], links + 1)
    builder = pbd.ModelBuilder()
    builder.add_rope(positions, mass=1.0, radius=0.2 * LENGTH / links)
    return pbd.Scene(builder, frames=60, method=pbd.Direct())
