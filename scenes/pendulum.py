"""A pendulum of one link falls from the horizontal and swings.

One distance constraint and gravity; its exact motion is known (elliptic functions), so it shows what a method and an
integrator do to amplitude and period. One should see it come back to where it started, or not.
"""

import numpy as np

import pbd_warp as pbd
from pbd_warp.scene import references

LENGTH = 1.0  # m


def scene(angle: float = 90.0) -> pbd.Scene:
    """`angle`: from the vertical at the start, in degrees."""
    start = np.radians(angle)
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), _at(start)], mass=[0.0, 1.0], radius=0.03)

    def reference(time: float) -> np.ndarray:
        return np.array([(0, 0, 0), _at(float(references().pendulum_angle(time, start, LENGTH)))])

    return pbd.Scene(
        builder, frames=240, substeps=2, method=pbd.Direct(), integrator="midpoint4", reference=reference,
        reference_text="the exact pendulum (elliptic functions)",
    )  # fmt: skip


def _at(angle: float) -> tuple[float, float, float]:
    return (LENGTH * np.sin(angle), -LENGTH * np.cos(angle), 0.0)
