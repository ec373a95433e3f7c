"""A chain hangs at rest between two hooks.

Distance constraints and gravity; it starts in the exact equilibrium, so whatever moves is the solver's error. One
should see nothing move; with too few iterations the chain sags.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references


def scene(links: int = 20, span: float = 0.6) -> pbd.Scene:
    """`span`: distance of the hooks, relative to the chain's length of 1 m."""
    positions = references().catenary(links, 1.0 / links, span)
    builder = pbd.ModelBuilder()
    builder.add_rope(positions, mass=1.0, pinned=(0, -1), radius=0.1 / links)

    def reference(time: float) -> np.ndarray:
        return positions

    return pbd.Scene(
        builder, frames=120, method=pbd.Direct(), reference=reference,
        reference_text="the equilibrium it starts in (discrete catenary)",
    )  # fmt: skip
