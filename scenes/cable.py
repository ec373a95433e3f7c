"""A thick cable lies over two supports.

Bending, distances, contacts and gravity. It starts as a beam on two supports hangs; one should see it stay there, its
middle sagging and its ends too. Without resistance to bending it would slip off in a heap.
"""

import numpy as np

import pbd_warp as pbd

LENGTH, APART = 2.0, 1.2  # m: of the cable, and from support to support
BENDING, MASS, RADIUS = 40.0, 2.0, 0.02  # N m^2, kg, m
SUPPORT = 0.05  # m: its radius


def scene(links: int = 40) -> pbd.Scene:
    """`links`: a multiple of 10, so that a particle lies on each support."""
    builder = pbd.ModelBuilder()
    along = np.linspace(-0.5 * LENGTH, 0.5 * LENGTH, links + 1)
    height = beam(along, -builder.gravity[1] * MASS / LENGTH / BENDING)
    x = np.stack([along, height, 0.0 * along], axis=1)
    builder.add_rope(x, mass=MASS, pinned=(), radius=RADIUS, bending=BENDING)
    for side in (-0.5, 0.5):
        builder.add_sphere((side * APART, -SUPPORT - RADIUS, 0.0), SUPPORT, friction=0.5)
    return pbd.Scene(
        builder, frames=120, substeps=4, method=pbd.Direct(), reference=lambda time: x,
        reference_text="a beam on two supports that bends by little", settings=pbd.Settings(drag=5.0),
    )  # fmt: skip


def beam(x: np.ndarray, load: float) -> np.ndarray:
    """Deflection of a beam on two supports [m]; load: weight of a metre over B. Its moment, from the free end in, is
    that of the weight beyond, and within the supports that of their push, too."""
    half, d = 0.5 * LENGTH, 0.5 * APART
    z = np.abs(x)

    def inner(z: np.ndarray) -> np.ndarray:
        """B y'' = R (d - z) - load (half - z)^2 / 2 with R = load half, twice integrated, y'(0) = 0."""
        return load * (half * (d * z**2 / 2.0 - z**3 / 6.0) - (half - z) ** 4 / 24.0 - half**3 * z / 6.0)

    def slope(z: float) -> float:
        return load * (half * (d * z - z**2 / 2.0) + (half - z) ** 3 / 6.0 - half**3 / 6.0)

    def outer(z: np.ndarray) -> np.ndarray:
        """B y'' = -load (half - z)^2 / 2, from the support on."""
        start = slope(d) - load * (half - d) ** 3 / 6.0
        return start * (z - d) - load * ((half - z) ** 4 - (half - d) ** 4) / 24.0

    return np.where(z <= d, inner(z) - inner(np.float64(d)), outer(z))
