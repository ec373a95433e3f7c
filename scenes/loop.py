"""A closed loop hangs from one of its particles and swings.

Distance constraints in a ring, and gravity. One should see a ring that is let go of collapse into two strands side by
side, and all its links keep their length.
"""

import numpy as np

import pbd_warp as pbd


def scene(links: int = 24) -> pbd.Scene:
    """links: Around the loop, of 1 m in all."""
    if links < 3:
        raise pbd.InputError(f"a loop has 3 links or more, not {links}")
    angle = 2.0 * np.pi * np.arange(links) / links
    radius = 0.5 / links / np.sin(np.pi / links)
    x = radius * np.stack([np.sin(angle), np.cos(angle) - 1.0, 0.0 * angle], axis=1)
    edges = np.stack([np.arange(links), np.roll(np.arange(links), -1)], axis=1)
    builder = pbd.ModelBuilder()
    builder.add_graph(x, edges, mass=0.2, pinned=(0,), radius=0.01)
    return pbd.Scene(builder, frames=120, substeps=4, method=pbd.Direct())
