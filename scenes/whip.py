"""A long chain falls from the horizontal, in steps that are long for it.

Distance constraints, gravity, no damping. One should see the end overtake the rest and crack; "bdf2" takes the crack's
energy away, the integrators that keep energy have nowhere to put it and fly apart where the step is too long.
"""

import numpy as np

import pbd_warp as pbd

LENGTH = 1.0  # m


def scene(links: int = 50, fps: float = 60.0) -> pbd.Scene:
    """`fps`: frames, and by default steps, a second."""
    builder = pbd.ModelBuilder()
    positions = np.linspace([0.0, 0, 0], [LENGTH, 0, 0], links + 1)
    builder.add_rope(positions, mass=1.0, radius=0.1 * LENGTH / links)
    return pbd.Scene(builder, frames=round(2.0 * fps), fps=fps, method=pbd.Direct(), integrator="bdf2")
