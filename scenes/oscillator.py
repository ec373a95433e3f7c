"""A mass on a spring swings to and fro.

One compliant distance constraint, no gravity; the exact motion is a cosine. One should see it come back to where it
started; what takes energy away brings it to rest instead.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references

LENGTH, STRETCH = 1.0, 0.25  # m


def scene(compliance: float = 0.01, mass: float = 1.0) -> pbd.Scene:
    """`compliance` of the spring [m/N], `mass` at its end [kg]."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (LENGTH + STRETCH, 0, 0)], mass=[0.0, mass], radius=0.03)
    builder.add_distance(0, 1, rest_length=LENGTH, compliance=compliance)

    def reference(time: float) -> np.ndarray:
        end = references().oscillator(time, LENGTH + STRETCH, mass, compliance, LENGTH)
        return np.array([(0, 0, 0), (float(end), 0, 0)])

    return pbd.Scene(
        builder, frames=240, substeps=4, method=pbd.Direct(), integrator="midpoint4", reference=reference,
        reference_text="the exact oscillator (cosine)",
    )  # fmt: skip
