"""A chain of rigid links falls from the horizontal and whips.

Distance constraints and gravity, no damping: what a rope's motion is without any loss. One should see the end overtake
the rest and crack like a whip; after the first second the motion is chaotic.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references

LENGTH = 1.0  # m

MOST_LINKS = 100
"""Above, the crack of the whip is too much for an integrator that damps nothing at a step of 1/120 s (map step)."""


def scene(links: int = 9) -> pbd.Scene:
    """`links`: how many the metre is made of."""
    builder = pbd.ModelBuilder()
    positions = np.linspace([0.0, 0, 0], [LENGTH, 0, 0], links + 1)
    builder.add_rope(positions, mass=1.0, pinned=(0,), radius=0.1 * LENGTH / links)

    def reference(time: float) -> np.ndarray:
        w = np.full(links + 1, float(links))
        w[0], w[-1] = 0.0, 2.0 * links
        at_rest = np.zeros_like(positions)
        return references().chain([time], positions, at_rest, w, builder.gravity)[0][-1]

    integrator, substeps = ("midpoint4", 2) if links <= MOST_LINKS else ("bdf2", 8)
    return pbd.Scene(
        builder, frames=240, substeps=substeps, method=pbd.Direct(), integrator=integrator, reference=reference,
        reference_text="the differential equations of the rigid chain, DOP853 at 1e-12",
    )  # fmt: skip
