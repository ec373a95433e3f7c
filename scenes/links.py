"""A chain of closed rings, each through the next, that hangs from its first and swings.

One should see every ring hold the next one, drawn long by what hangs below, and no strand pass through another: the
linking number of neighbours stays 1 or -1.
"""

import numpy as np

import pbd_warp as pbd

RING, THICK = 0.05, 0.006  # m: radius of a ring, and of its strand
APART = 0.062  # m: between the middles of neighbours


def scene(rings: int = 5, corners: int = 12) -> pbd.Scene:
    builder = pbd.ModelBuilder()
    around = np.stack([np.arange(corners), np.roll(np.arange(corners), -1)], axis=1)
    for ring in range(rings):
        builder.add_graph(points(ring, corners), around, mass=0.05, pinned=(0,) if ring == 0 else (), radius=THICK)
    builder.enable_contacts(friction=0.2, links=True)
    return pbd.Scene(builder, frames=240, substeps=32, method=pbd.GaussSeidel(8), damping=0.05)


def points(ring: int, corners: int) -> np.ndarray:
    """Rings that stand in planes across each other, in turn, along a line at 30 degrees to the vertical."""
    angle = 2.0 * np.pi * np.arange(corners) / corners + np.pi / 2.0
    way = np.array([0.5, -np.sqrt(0.75), 0.0])
    side = np.array([0.0, 0.0, 1.0]) if ring % 2 else np.array([np.sqrt(0.75), 0.5, 0.0])
    middle = ring * APART * way
    return middle + RING * (np.outer(np.cos(angle), side) - np.outer(np.sin(angle), way))
