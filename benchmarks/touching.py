"""What contacts of links cost beside those of particles, for the same particles, distances and number of pairs.

    python benchmarks/touching.py

Pairs of rods that as good as touch, one across the other at their middles where links collide, end to end where
particles do. No gravity, so that they stay; both in turn, the median over rounds of the ratio. Then link contacts with
a grid over those where each link looks at all others, which says from how many links on a grid pays (WITHOUT_GRID of
step/constraints/link_contact.py).
"""

from __future__ import annotations

import statistics
import time

import numpy as np
import typer
import warp as wp

import pbd_warp as pbd
from pbd_warp.step.constraints import link_contact

RADIUS, LENGTH, APART = 0.01, 0.1, 0.3  # m: of rods, and from pair to pair
FRAMES = 20

SETTINGS = {
    "jacobi, 20 iterations": {"method": pbd.Jacobi(20)},
    "gauss-seidel, 1 iteration, 16 substeps": {"method": pbd.GaussSeidel(1), "substeps": 16},
    "jacobi, 2 iterations": {"method": pbd.Jacobi(2)},
}


def simulation(pairs: int, links: bool, dtype: str = "float32", **settings: object) -> pbd.Simulation:
    side = int(np.ceil(np.cbrt(pairs)))
    place = APART * np.stack(np.unravel_index(np.arange(pairs), (side, side, side)), axis=1)
    half, touch = 0.5 * LENGTH, 2.02 * RADIUS
    one = np.array([(-half, 0, 0), (half, 0, 0)])
    other = np.array(
        [(0, touch, -half), (0, touch, half)] if links else [(half + touch, 0, 0), (half + touch, 0, half)]
    )
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    x = place[:, None, None] + np.stack([one, other])
    rods = builder.add_particles(x.reshape(-1, 3), mass=0.1, radius=RADIUS)
    builder.add_distances(np.reshape(rods, (-1, 2)))
    builder.enable_contacts(links=links)
    return pbd.Simulation(builder.finalize(dtype=dtype), **settings)  # type: ignore[arg-type]


def seconds(sim: pbd.Simulation) -> float:
    start = time.perf_counter()
    for _ in range(FRAMES):
        sim.step()
    return (time.perf_counter() - start) / FRAMES


def ratio(one: pbd.Simulation, other: pbd.Simulation, rounds: int) -> tuple[float, float, float]:
    """Median times a frame [s], and the median of their ratio."""
    for sim in (one, other):
        sim.step()
    times = [(seconds(one), seconds(other)) for _ in range(rounds)]
    a, b = (statistics.median(column) for column in zip(*times, strict=True))
    return a, b, statistics.median(x / y for x, y in times)


def main(rounds: int = 7) -> None:
    wp.config.log_level = wp.LOG_ERROR
    print(f"ms a frame, their ratio (median of {rounds} rounds)")
    print(f"{'':40} {'pairs':>6} {'links':>8} {'particles':>10} {'ratio':>6}")
    for name, settings in SETTINGS.items():
        for pairs in (30, 1000):
            links, particles = (simulation(pairs, which, **settings) for which in (True, False))
            a, b, r = ratio(links, particles, rounds)
            assert len(links.link_pairs) == len(particles.contact_pairs) == pairs
            print(f"{name:40} {pairs:6} {1e3 * a:8.3f} {1e3 * b:10.3f} {r:6.2f}", flush=True)
    print(f"\n{'links':>6} {'grid':>8} {'all':>10} {'ratio':>6}")
    for pairs in (30, 60, 75, 100, 200):
        sims = []
        for without in (0, 10**6):
            link_contact.WITHOUT_GRID = without
            sims.append(simulation(pairs, True, method=pbd.Jacobi(1)))
        a, b, r = ratio(sims[0], sims[1], rounds)
        print(f"{2 * pairs:6} {1e3 * a:8.3f} {1e3 * b:10.3f} {r:6.2f}", flush=True)


if __name__ == "__main__":
    typer.run(main)
