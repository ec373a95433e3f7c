"""What the guard rails cost: the watch for divergence beside the frame that it watches.

    python benchmarks/guard_rails.py

10 000 particles. The watch is captured by itself, 10 times over, since in a frame it is not a graph of its own to be
started, and replayed, so that its share does not drown in the noise of two long runs; both in turn, the median over
rounds of the ratio.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np
import typer
import warp as wp

import pbd_warp as pbd

PARTICLES = 10_000
REPEATS = 20
WATCHES = 10

SETTINGS = {
    "jacobi, 20 iterations": {"method": pbd.Jacobi(20)},
    "gauss-seidel, 1 iteration, 32 substeps": {"method": pbd.GaussSeidel(1), "substeps": 32},
    "direct": {"method": pbd.Direct()},
}
LIMITS = {"stretch": pbd.Limits(stretch=1e9), "stretch and energy": pbd.Limits(stretch=1e9, energy=1e9)}
"""Never reached: 20 iterations of Jacobi let such ropes stretch a lot."""


def simulation(limits: pbd.Limits, dtype: str, **settings: object) -> pbd.Simulation:
    """Ropes of 100 links that fall from the horizontal."""
    builder = pbd.ModelBuilder()
    for rope in range(PARTICLES // 100):
        builder.add_rope(np.linspace([0, 0, rope], [1, 0, rope], 100), mass=1.0)
    return pbd.Simulation(builder.finalize(dtype=dtype), limits=limits, **settings)  # type: ignore[arg-type]


def seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    for _ in range(REPEATS):
        call()
    return (time.perf_counter() - start) / REPEATS


def main(rounds: int = 15) -> None:
    wp.config.log_level = wp.LOG_ERROR
    print(f"{PARTICLES} particles; ms a frame, us the watch, their ratio (median of {rounds} rounds)")
    print(f"{'':40} {'limits':20} {'dtype':8} {'frame':>8} {'watch':>8} {'ratio':>8}")
    for name, settings in SETTINGS.items():
        for what, limits in LIMITS.items():
            for dtype in ("float32", "float64"):
                sim = simulation(limits, dtype, **settings)
                with wp.ScopedCapture(device=sim.model.device, force_module_load=False) as capture:
                    for _ in range(WATCHES):
                        sim._loop.monitor.launch()
                for _ in range(3):
                    sim.step()
                graph = capture.graph
                times = []
                for _ in range(rounds):
                    times.append((seconds(sim.step), seconds(lambda graph=graph: wp.capture_launch(graph)) / WATCHES))
                frame, watch = (statistics.median(column) for column in zip(*times, strict=True))
                ratio = statistics.median(b / a for a, b in times)
                print(f"{name:40} {what:20} {dtype:8} {1e3 * frame:>8.3f} {1e6 * watch:>8.1f} {100 * ratio:>7.2f}%")


if __name__ == "__main__":
    typer.run(main)
