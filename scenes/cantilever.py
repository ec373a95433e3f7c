"""A rod, clamped at one end, holds itself up.

Bending, distances and gravity; it starts in the equilibrium of a continuous rod, so whatever moves is the error of its
links. One should see nothing move; sweeps let the rod sag, further the stiffer it is and the fewer they are.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references

LENGTH = 1.0  # m
MASS = 0.1  # kg


def scene(links: int = 20, bending: float = 1.0) -> pbd.Scene:
    """`bending`: B = E I [N m^2]; the tip sinks by some 0.12 m / B."""
    rods = references()
    s = rods.clamped(links, LENGTH)
    builder = pbd.ModelBuilder()
    shape = rods.elastica(s, LENGTH, bending, weight=(0.0, MASS / LENGTH * builder.gravity[1]))
    x = rods.on_clamp(s, shape)
    length = np.linalg.norm(np.diff(x, axis=0), axis=1)
    builder.add_rope(x, mass=MASS * length.sum() / LENGTH, pinned=(0, 1), radius=0.01, bending=bending)
    return pbd.Scene(
        builder, frames=120, substeps=4, method=pbd.Direct(), reference=lambda time: x,
        reference_text="the equilibrium of a continuous rod (elastica)", settings=pbd.Settings(drag=5.0),
    )  # fmt: skip
