"""A heavy bob on a light chain falls from the horizontal and swings.

Distance constraints, gravity and a mass ratio. One should see a pendulum whose chain stays taut and straight; iterative
methods let the bob pull the chain long, further the heavier it is.
"""

import numpy as np

import pbd_warp as pbd

LENGTH = 1.0  # m


def scene(ratio: float = 1e3, links: int = 20) -> pbd.Scene:
    """`ratio`: mass of the bob over that of any other particle."""
    positions = np.linspace([0.0, 0, 0], [LENGTH, 0, 0], links + 1)
    masses = np.full(links + 1, 0.01)
    masses[0], masses[-1] = 0.0, 0.01 * ratio
    radius = np.full(links + 1, 0.1 * LENGTH / links)
    radius[-1] *= 5.0
    builder = pbd.ModelBuilder()
    builder.add_rope(positions, mass=masses, radius=radius)
    return pbd.Scene(builder, frames=180, substeps=2, method=pbd.Direct(), integrator="bdf2")
