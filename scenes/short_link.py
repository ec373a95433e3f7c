"""A chain with one link that is far shorter than the others, as real curves have at their roots.

Distance constraints and gravity. One should see it swing like any other; the short link keeps its length too.
"""

import numpy as np

import pbd_warp as pbd

LINKS = 10
LENGTH = 0.1  # m, of the others


def scene(ratio: float = 1e-4) -> pbd.Scene:
    """ratio: The first link's length over that of the others."""
    if not 0.0 < ratio <= 1.0:
        raise pbd.InputError(f"ratio must be in (0, 1], not {ratio:g}")
    along = np.r_[0.0, LENGTH * (ratio + np.arange(LINKS))]
    builder = pbd.ModelBuilder()
    x = np.stack([along, 0.0 * along, 0.0 * along], axis=1)
    builder.add_rope(x, mass=[0.02] * len(x), pinned=(0,), radius=0.005)
    return pbd.Scene(builder, frames=60, substeps=4, method=pbd.Direct())
