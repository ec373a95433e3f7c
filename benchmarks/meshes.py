"""What a step takes with 1000 links above a mesh of 10 000 triangles, and what of it the mesh does.

    python benchmarks/meshes.py [--float64]

A rope lies on a bumpy torus. The same step is timed without the mesh, with a plane instead of it, and with it, in turn.
"""

from __future__ import annotations

import sys
import time

import numpy as np
import warp as wp

import pbd_warp as pbd

LINKS, RINGS, SIDES = 1000, 100, 50
SUBSTEPS, FRAMES, ROUNDS = 10, 12, 5


def torus(large: float = 1.0, small: float = 0.35) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles, 2 RINGS SIDES of them."""
    around, across = np.meshgrid(
        2 * np.pi * np.arange(RINGS) / RINGS, 2 * np.pi * np.arange(SIDES) / SIDES, indexing="ij"
    )
    rho = large + small * (1.0 + 0.05 * np.sin(9 * around)) * np.cos(across)
    points = np.stack([rho * np.sin(around), small * np.sin(across), rho * np.cos(around)], axis=-1).reshape(-1, 3)
    corner = np.arange(RINGS * SIDES).reshape(RINGS, SIDES)
    b, d = np.roll(corner, -1, axis=0), np.roll(corner, -1, axis=1)
    c = np.roll(b, -1, axis=1)
    return points, np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in ((corner, b, c), (corner, c, d))])


def simulation(what: str, method: pbd.Jacobi | pbd.Direct, dtype: str) -> pbd.Simulation:
    """A spiral of rope that lies on the torus, or hangs in the air."""
    builder = pbd.ModelBuilder()
    angle = np.linspace(0.0, 6.0 * np.pi, LINKS + 1)
    rho = np.linspace(0.8, 1.2, LINKS + 1)
    height = np.sqrt(np.maximum(0.35**2 - (rho - 1.0) ** 2, 0.0)) + 0.03
    builder.add_rope(np.stack([rho * np.sin(angle), height, rho * np.cos(angle)], axis=1), pinned=(0,), radius=0.008)
    if what == "plane":
        builder.add_plane((0, 0.2, 0), (0, 1, 0), friction=0.3)
    elif what == "mesh":
        builder.add_mesh(*torus(), friction=0.3)
    return pbd.Simulation(builder.finalize(dtype=dtype), method=method, substeps=SUBSTEPS)


def main() -> None:
    wp.config.log_level = wp.LOG_ERROR
    dtype = "float64" if "--float64" in sys.argv else "float32"
    print(f"{LINKS} links, {2 * RINGS * SIDES} triangles, {dtype}: ms a step, median of {ROUNDS}")
    for method in (pbd.Jacobi(), pbd.Direct()):
        sims = {what: simulation(what, method, dtype) for what in ("nothing", "plane", "mesh")}
        spent: dict[str, list[float]] = {what: [] for what in sims}
        for sim in sims.values():
            sim.step(frames=20)  # the rope comes to lie on what there is
        for _ in range(ROUNDS):
            for what, sim in sims.items():
                start = time.perf_counter()
                sim.step(frames=FRAMES)
                spent[what].append(1e3 * (time.perf_counter() - start) / FRAMES / SUBSTEPS)
        text = ", ".join(f"{what} {np.median(times):.3f}" for what, times in spent.items())
        touching = len(np.unique(sims["mesh"].contact_pairs[:, 0]))
        print(f"  {method.name:7} {text}; {touching} particles near the mesh")


if __name__ == "__main__":
    main()
