"""Many spokes meet in one hub, which starts a little off the middle.

Distance constraints, no gravity. One should see the hub slide to the middle of the tips and all spokes come to their
length; the plain sum of all corrections throws the hub further to the other side each time, until nothing is left.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.errors import unknown

OFF = 0.03  # m, of spokes 1 m long
SHAPES = ("planar", "space", "line")


def scene(spokes: int = 16, shape: str = "planar") -> pbd.Scene:
    """`shape`: spokes in a "planar" wheel, in "space" on a cone so steep that all directions count alike, or on a
    "line", to both sides in turn."""
    if shape not in SHAPES:
        raise unknown("shape of the star", shape, SHAPES)
    angle = 2.0 * np.pi * np.arange(spokes) / spokes
    wheel = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    if shape == "space":
        wheel = np.sqrt(2.0 / 3.0) * wheel + [0.0, 0.0, np.sqrt(1.0 / 3.0)]
    if shape == "line":
        wheel = np.outer(1.0 - 2.0 * (np.arange(spokes) % 2), [1.0, 0, 0])
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particle((OFF, 0, 0), radius=0.05)
    builder.add_particles(wheel, radius=0.03)
    builder.add_distances([(0, 1 + k) for k in range(spokes)], rest_length=1.0)
    return pbd.Scene(builder, frames=60, method=pbd.Jacobi())
