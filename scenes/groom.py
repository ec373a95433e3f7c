"""Hair with a shape: locks that were built curled, and keep their style under gravity as their stiffness allows.

Bending with rest_shape="as_built". One should see them swing a little and come to rest near the shape they were built
in, the softer the further down.
"""

import numpy as np

import pbd_warp as pbd

LENGTH, RADIUS = 0.1, 1e-4  # m: of a lock, and of a hair
CURVATURE = 16.0  # 1/m
HAIRS = 12


def scene(links: int = 24, youngs_modulus: float = 4e9) -> pbd.Scene:
    """`youngs_modulus`: of hair, some 4e9 Pa."""
    builder = pbd.ModelBuilder()
    section = pbd.RoundSection(RADIUS, youngs_modulus, density=1300.0)
    for side in np.linspace(0.0, 2.0 * np.pi, HAIRS, endpoint=False):
        builder.add_rope(arc(links, side), pinned=(0, 1), section=section, rest_shape="as_built")
    return pbd.Scene(builder, frames=240, substeps=4, method=pbd.Direct(), settings=pbd.Settings(drag=4.0))


def arc(links: int, side: float) -> np.ndarray:
    """A lock that grows sideways and curls up, shape [links + 1, 3]; clamped in the middle of its first link."""
    s = LENGTH / (links - 0.5) * (np.arange(links + 1) - 0.5)
    turn = CURVATURE * np.maximum(s, 0.0)
    out, up = np.sin(turn) / CURVATURE, (1.0 - np.cos(turn)) / CURVATURE
    out = np.where(s < 0.0, s, out)
    return np.stack([out * np.cos(side), up, out * np.sin(side)], axis=1)
