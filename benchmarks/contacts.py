"""What `Direct` costs where things touch, and on nets.

    python benchmarks/contacts.py [--frames 60] [--only capstan,piles,nets]

Takes two minutes. Everything at 60 Hz with 4 substeps.

capstan: a rope of 120 links and 0.01 kg over a ball, 1 kg at one end and 0.97 or 1.03 times at the other what the
capstan equation of the polygon holds; milliseconds a frame (least of all frames, and mean), iterations a step, and how
fast the heavy end goes in the end: creep below the limit, sliding above it.
piles: discs in a corner, ropes across each other: contacts of particles that both move.
nets: k x k particles held at one corner; products of tiles in an iteration, the least time one took in a frame, and the
exponents of both from one k to the next: k^3 is what an elimination by minimum degree may take.
"""

import argparse
import math
import time

import numpy as np
import warp as wp

import pbd_warp as pbd

BALL = 0.3
SUBSTEPS = 4


def capstan(friction: float, part: float, dtype: str, links: int = 120) -> pbd.Model:
    """Turns over half the ball, hangs down on both sides."""
    side = 0.6
    total = math.pi * BALL + 2 * side
    along = np.linspace(0.0, total, links + 1)
    angle = np.clip(math.pi - (along - side) / BALL, 0.0, math.pi)
    x = BALL * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    x[:, 1] -= np.maximum(side - along, 0.0) + np.maximum(along - total + side, 0.0)
    d = np.diff(x, axis=0)
    d /= np.linalg.norm(d, axis=1)[:, None]
    tangent = friction * np.tan(np.arccos(np.clip(np.sum(d[1:] * d[:-1], axis=1), -1.0, 1.0)) / 2)
    tangent = tangent[np.abs(np.linalg.norm(x[1:-1], axis=1) - BALL) < 1e-9]
    mass = np.full(links + 1, 0.01 / (links + 1))
    mass[0] += 1.0
    mass[-1] += part * np.prod((1 + tangent) / (1 - tangent))
    builder = pbd.ModelBuilder()
    builder.add_particles(x, mass=mass)
    builder.add_distances(np.c_[np.arange(links), np.arange(1, links + 1)])
    builder.add_sphere((0, 0, 0), BALL, friction=friction)
    return builder.finalize(dtype=dtype)


def pile(discs: int, dtype: str) -> pbd.Model:
    rng = np.random.default_rng(0)
    builder = pbd.ModelBuilder()
    k = np.arange(discs)
    x = np.c_[-0.3 + 0.15 * (k % 4), 0.08 + 0.13 * (k // 4), 0 * k]
    x[:, 0] += 0.02 * rng.normal(size=discs)
    builder.add_particles(x, mass=1.0, radius=rng.uniform(0.03, 0.05, discs))
    for point, normal in ((0, 0, 0), (0, 1, 0)), ((-0.45, 0, 0), (1, 0, 0)), ((0.25, 0, 0), (-1, 0, 0)):
        builder.add_plane(point, normal, friction=0.5)
    builder.enable_contacts(friction=0.5)
    return builder.finalize(dtype=dtype)


def ropes(dtype: str) -> pbd.Model:
    """One held by both ends, another that falls onto it."""
    builder = pbd.ModelBuilder()
    t = np.linspace(-1.0, 1.0, 21)
    builder.add_rope(np.c_[0.49 * t, 0.05 * t * t, 0 * t], mass=1.0, pinned=(0, 20), radius=0.03)
    builder.add_rope(np.c_[0.003 + 0.02 * t * t, 0.015 + 0.02 * t * t, 0.49 * t], mass=0.5, pinned=(), radius=0.03)
    builder.enable_contacts(friction=0.3)
    return builder.finalize(dtype=dtype)


def net(k: int) -> pbd.Model:
    a, b = np.meshgrid(np.arange(k), np.arange(k), indexing="ij")
    q = np.arange(k * k).reshape(k, k)
    edges = np.r_[np.c_[q[:-1].ravel(), q[1:].ravel()], np.c_[q[:, :-1].ravel(), q[:, 1:].ravel()]]
    builder = pbd.ModelBuilder()
    mass = np.full(k * k, 1.0 / k**2)
    mass[0] = 0.0
    builder.add_particles(np.stack([a, 0 * a, b], -1).reshape(-1, 3) / (k - 1.0), mass=mass)
    builder.add_distances(edges)
    return builder.finalize(dtype="float64")


def run(model: pbd.Model, frames: int) -> tuple[pbd.Simulation, np.ndarray, np.ndarray, int]:
    """The simulation, milliseconds and iterations of each frame, and steps that did not converge in all."""
    sim = pbd.Simulation(model, substeps=SUBSTEPS, method=pbd.Direct(), on_failure="continue")
    ms, iterations, unconverged = [], [], 0
    for _ in range(frames):
        start = time.perf_counter()
        sim.step()
        ms.append(1e3 * (time.perf_counter() - start))
        iterations.append(sim.iterations_used)
        unconverged += sim.unconverged or 0
    return sim, np.array(ms), np.array(iterations), unconverged


def capstans(frames: int) -> None:
    print(
        f"{'dtype':>8} {'friction':>9} {'load':>5} {'ms min':>7} {'mean':>6} {'iterations':>11} {'m/s':>9} unconverged"
    )
    for dtype in ("float64", "float32"):
        for friction in (0.1, 0.3, 0.8):
            for part in (0.97, 1.03):
                sim, ms, iterations, unconverged = run(capstan(friction, part, dtype), frames)
                before = float(sim.state.x.numpy()[-1, 1])
                for _ in range(20):
                    sim.step()
                speed = (before - float(sim.state.x.numpy()[-1, 1])) / (20 * sim.dt)
                each = iterations.mean() / SUBSTEPS
                print(
                    f"{dtype:>8} {friction:>9g} {part:>5g} {ms.min():>7.2f} {ms.mean():>6.2f} {each:>11.1f} "
                    f"{speed:>9.1e} {unconverged}",
                    flush=True,
                )


def piles(frames: int) -> None:
    print(f"\n{'dtype':>8} {'scene':>9} {'ms min':>7} {'mean':>7} {'iterations':>11} {'overlap':>8} unconverged")
    for dtype in ("float64", "float32"):
        scenes = {"8 discs": pile(8, dtype), "24 discs": pile(24, dtype), "2 ropes": ropes(dtype)}
        for name, model in scenes.items():
            sim, ms, iterations, unconverged = run(model, frames)
            pieces = 2 if name == "2 ropes" else model.particle_count
            each = iterations.mean() / (SUBSTEPS * pieces)
            overlap = pbd.measure(sim).overlap
            print(
                f"{dtype:>8} {name:>9} {ms.min():>7.2f} {ms.mean():>7.2f} {each:>11.1f} {overlap:>8.0e} {unconverged}",
                flush=True,
            )


def nets(_frames: int) -> None:
    print(f"\n{'net':>9} {'products':>9} {'exponent':>9} {'ms':>8} {'exponent':>9} {'iterations':>11} unconverged")
    before = None
    for k in (10, 20, 40, 60):
        sim, ms, iterations, unconverged = run(net(k), max(5, 200 // k))
        products = int(np.sum(np.diff(sim._loop.solver.schedule.column_first) ** 2))
        now = np.array([k, products, (ms / iterations).min()])
        exponents = (
            [""] * 2 if before is None else [f"{e:.2f}" for e in np.log(now / before)[1:] / np.log(k / before[0])]
        )
        before = now
        print(
            f"{f'{k} x {k}':>9} {products:>9} {exponents[0]:>9} {now[2]:>8.3f} {exponents[1]:>9} "
            f"{iterations.mean() / SUBSTEPS:>11.1f} {unconverged}",
            flush=True,
        )


def main() -> None:
    parts = {"capstan": capstans, "piles": piles, "nets": nets}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=60, help="of each run (60)")
    parser.add_argument("--only", default=",".join(parts), help="which parts, separated by commas (all)")
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    for name in arguments.only.split(","):
        parts[name](arguments.frames)


if __name__ == "__main__":
    main()
