"""A column, clamped at its foot, carries a weight on its top, and buckles where that is more than Euler's load.

Bending, distances and gravity. Above pi^2 B / (4 L^2) it starts in the bent equilibrium of a continuous column, below
it straight; one should see nothing move in either.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references

LENGTH, BENDING, MASS = 1.0, 1.0, 1e-3  # m, N m^2, kg: the column's


def scene(links: int = 60, load: float = 1.5) -> pbd.Scene:
    """`load`: the weight, over Euler's load."""
    rods = references()
    s = rods.clamped(links, LENGTH)
    builder = pbd.ModelBuilder()
    gravity = builder.gravity[1]
    weight = load * np.pi**2 * BENDING / (4.0 * LENGTH**2)
    shape = np.stack([0.0 * s, s, 0.0 * s], axis=1)
    if load > 1.0:
        own = (0.0, MASS / LENGTH * gravity)
        bent = (-np.pi / 2.0, np.pi / 2.0 - 1e-2)
        shape = rods.elastica(s, LENGTH, BENDING, (0.0, -weight), own, angle=np.pi / 2.0, tip=bent)
    x = rods.on_clamp(s, shape, np.pi / 2.0)
    mass = np.full(links + 1, MASS / (links - 0.5))
    mass[-1] = 0.5 * mass[-1] - weight / gravity
    builder.add_rope(x, mass=mass, pinned=(0, 1), radius=0.01, bending=BENDING)
    return pbd.Scene(
        builder, frames=120, substeps=4, method=pbd.Direct(), reference=lambda time: x,
        reference_text="Euler's elastica, by shooting", settings=pbd.Settings(drag=5.0),
    )  # fmt: skip
