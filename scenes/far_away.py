"""A pendulum of one link swings far away from the origin.

One distance constraint and gravity. One should see the same swing at any distance; in float32, positions have fewer
digits the further away they are, and a method that takes velocities from positions moves in jerks, then not at all.
"""

import numpy as np

import pbd_warp as pbd

LENGTH = 1.0  # m


def scene(distance: float = 1000.0) -> pbd.Scene:
    """`distance` from the origin, along x and y each [m]."""
    builder = pbd.ModelBuilder()
    positions = np.array([(0.0, 0, 0), (LENGTH, 0, 0)]) + np.array((distance, distance, 0))
    builder.add_rope(positions, mass=[0.0, 1.0], radius=0.03)
    return pbd.Scene(builder, frames=120, substeps=4, method=pbd.GaussSeidel(1))
