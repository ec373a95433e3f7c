"""Ropes that touch, for 20 s in both precisions: `python benchmarks/touching.py [SCENE ...]`.

Prints of each run how many strands passed through another, the deepest overlap and the largest stretch in any frame.
"""

import sys
import time

import pbd_warp as pbd
from pbd_warp.measure import measure

SCENES = ("pile", "links", "knot")
SECONDS = 20.0

if __name__ == "__main__":
    for name in sys.argv[1:] or SCENES:
        scene = pbd.load_scene(name)
        for dtype in "float32", "float64":
            sim = pbd.Simulation(scene.builder.finalize(dtype=dtype), scene.settings)
            sim.watch_crossings()
            overlap = stretch = 0.0
            start = time.perf_counter()
            for _ in range(round(SECONDS / sim.dt)):
                sim.step()
                now = measure(sim)
                overlap, stretch = max(overlap, now.overlap), max(stretch, now.max_stretch)
            pace = SECONDS / (time.perf_counter() - start)
            print(
                f"{name:6} {dtype}: {len(sim.crossings)} passages, overlap {1e3 * overlap:.3g} mm, "
                f"stretch {100 * stretch:.3g} %, {pace:.2g} times real time",
                flush=True,
            )
