"""A light chain with a heavy bob hangs straight down.

Distance constraints, gravity and a mass ratio; it starts in the exact equilibrium, so whatever moves is the solver's
error. One should see nothing move; iterative methods let the bob sink, further the heavier it is.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references


def scene(links: int = 20, ratio: float = 100.0) -> pbd.Scene:
    """`ratio`: mass of the bob over that of the other particles."""
    masses = np.full(links, 1.0 / links)
    masses[-1] *= ratio
    positions, _ = references().hanging_chain(masses, 1.0 / links)
    builder = pbd.ModelBuilder()
    builder.add_rope(positions, mass=[0.0, *masses], radius=0.1 / links)

    def reference(time: float) -> np.ndarray:
        return positions

    return pbd.Scene(
        builder, frames=120, method=pbd.Direct(), reference=reference,
        reference_text="the equilibrium it starts in (straight down)",
    )  # fmt: skip
