"""A strip, clamped at one end, is bent far down by a weight at the other.

Bending, distances and gravity. It starts in the equilibrium of a continuous strip, Euler's elastica; one should see
nothing move.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references

LENGTH, BENDING, MASS = 1.0, 0.1, 0.01  # m, N m^2, kg: the strip's


def scene(links: int = 40, load: float = 10.0) -> pbd.Scene:
    """`load`: the weight, over B / L^2; at 3 the tip sinks by 0.6 of the length, at 10 by 0.81."""
    rods = references()
    s = rods.clamped(links, LENGTH)
    builder = pbd.ModelBuilder()
    gravity = builder.gravity[1]
    force = (0.0, -load * BENDING / LENGTH**2)
    shape = rods.elastica(s, LENGTH, BENDING, force, (0.0, MASS / LENGTH * gravity))
    x = rods.on_clamp(s, shape)
    mass = np.full(links + 1, MASS / (links - 0.5))
    mass[-1] = 0.5 * mass[-1] + force[1] / gravity
    builder.add_rope(x, mass=mass, pinned=(0, 1), radius=0.005, bending=BENDING)
    return pbd.Scene(
        builder, frames=120, substeps=4, method=pbd.Direct(), reference=lambda time: x,
        reference_text="Euler's elastica, by shooting", settings=pbd.Settings(drag=5.0),
    )  # fmt: skip
