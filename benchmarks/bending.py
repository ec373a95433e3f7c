"""What resistance to bending costs a path with Direct, and how far ahead of real time stiff rods are.

    python benchmarks/bending.py

Each rod with and without bending in one run, in turn, the best of five seconds of it; 50 links, 60 Hz.
"""

from __future__ import annotations

import time

import numpy as np

import pbd_warp as pbd

LINKS = 50
RODS = {"soft cable": (5e-3, 1e6, 1000.0), "suture": (2e-4, 750e6, 1100.0), "steel rod": (5e-3, 50e9, 7800.0)}


def hanging(name: str, bends: bool, substeps: int) -> pbd.Simulation:
    section = pbd.RoundSection(*RODS[name])
    builder = pbd.ModelBuilder()
    x = np.linspace([0.0, 0, 0], [1, 0, 0], LINKS + 1)
    mass = section.mass(np.full(LINKS, 1.0 / LINKS))
    builder.add_rope(x, mass=mass, bending=section.bending if bends else 0.0)
    return pbd.Simulation(builder.finalize(dtype="float64"), method=pbd.Direct(), substeps=substeps)


def second(sim: pbd.Simulation) -> tuple[float, float]:
    """Of 60 frames from the start: wall clock [s], iterations a step."""
    sim.reset()
    used, spent = 0, 0.0
    for _ in range(60):
        start = time.perf_counter()
        sim.step()
        spent += time.perf_counter() - start
        used += sim.iterations_used
    return spent, used / (60.0 * sim.settings.steps_a_frame)


if __name__ == "__main__":
    print(f"{'rod':12} {'substeps':>8} {'iterations':>10} {'x real time':>11} {'x without bending':>18}")
    for name in RODS:
        for substeps in (1, 4):
            pair = [hanging(name, bends, substeps) for bends in (True, False)]
            times = [[second(sim) for sim in pair] for _ in range(6)][1:]
            best = [min(each[k][0] for each in times) for k in (0, 1)]
            figures = f"{times[0][0][1]:10.2f} {1.0 / best[0]:11.0f} {best[0] / best[1]:18.2f}"
            print(f"{name:12} {substeps:8} {figures}", flush=True)
