"""What the methods cost: Direct beside the same elimination in plain C, and all of them to the same stretch.

    python benchmarks/methods.py [--rounds 9]

Needs gcc and SciPy (the latter for chebyshev="auto"); takes about a minute.

1. ns per link and Newton iteration of `Direct`, in both precisions, "pbd", one step a frame, 3 iterations: one rope of
   50, 1000 and 100 000 links, and 1000 ropes of 100. The C loop (elimination.c, compiled by
   `gcc -O3 -march=native -ffast-math`) makes the iterations; the simulation makes the whole step. Both are timed in
   turn, round by round, and each is given by its median, so that a drifting clock does not favour one. That both arrive
   at the same displacement is checked first, on every size; a difference ends the script with an error.
2. What 0.1 % stretch costs with each method: ropes of 1 m, 100 and 1000 links, fall from the horizontal for 0.25 s at
   60 Hz with 4 substeps, float64. Every method stops where by its own measure the largest |C| is under 0.1 % of a
   link, or at a cap of 6 000 000 / links iterations; where that was not enough, the stretch it got to is what counts.
   "max stretch" is measured at the end of every frame. One run each, only the frames are timed.
"""

import argparse
import ctypes
import statistics
import sys
import time
from dataclasses import dataclass

import numpy as np
import warp as wp
from plain_c import compile_c, timed

import pbd_warp as pbd

ITERATIONS = 3
NEVER = 1e-300
"""A tolerance [m] that no iteration gets under."""

DT = 1.0 / 24000.0
"""So short that 3 iterations do for 100 000 links too, and every size solves the same motion."""

ROPES = ((1, 50), (1, 1000), (1, 100_000), (1000, 100))
"""Number of ropes, links of each."""

AGREEMENT = {"float64": 1e-9, "float32": 1e-3}
"""How far ours and C may lie apart, over the largest displacement."""

STRETCH = 1e-3
FRAMES = 15
SUBSTEPS = 4


def swinging(ropes: int, links: int, dtype: str) -> pbd.Simulation:
    """Arcs of 10 m that turn about their pinned first particle, a few steps on: every link is pulled and turns."""
    builder = pbd.ModelBuilder()
    t = np.linspace(0.0, 1.0, links + 1)
    arc = 10.0 * np.stack([np.sin(t), np.cos(t) - 1.0, 0.1 * np.sin(3.0 * t)], axis=1)
    for rope in range(ropes):
        builder.add_rope(arc + np.array([0.0, 0.0, rope]), mass=1.0, pinned=(0,))
    method = pbd.Direct(ITERATIONS, NEVER)
    sim = pbd.Simulation(builder.finalize(dtype=dtype), dt=DT, method=method, on_failure="continue")
    sim.state.v.assign(np.tile(np.cross((0.0, 0.0, 2.0), arc), (ropes, 1)))
    for _ in range(5):
        sim.step()
    return sim


class Elimination:
    """The Newton iterations of a simulation's next step, in C."""

    def __init__(self, library: ctypes.CDLL, sim: pbd.Simulation, ropes: int, links: int):
        model = sim.model
        count = ropes * (links + 1)
        x, v = sim.state.x.numpy(), sim.state.v.numpy()
        first = np.arange(ropes + 1, dtype=np.int32) * (links + 1)
        rest, self._lam_before = np.zeros(count, x.dtype), np.zeros(count, x.dtype)
        rest[model.distance.edge[:, 0]] = model.distance.rest_length
        self._lam_before[model.distance.edge[:, 0]] = -sim._loop.solver.tension() * DT**2
        self._base = (DT * np.where(model.w[:, None] > 0.0, v + DT * np.asarray(model.gravity), v)).astype(x.dtype)
        self._lam, self.u = np.empty(count, x.dtype), np.empty((count, 3), x.dtype)
        place = np.empty((count, 17), x.dtype)
        self._arrays = (first, rest, x, model.w.astype(x.dtype), self._base, place, self._lam, self.u)
        self._arguments = (ropes, ITERATIONS, *(ctypes.c_void_p(a.ctypes.data) for a in self._arrays))
        self._library = library

    def __call__(self) -> None:
        self.u[:] = self._base
        self._lam[:] = self._lam_before
        self._library.eliminate(*self._arguments)


def check_agreement(c: Elimination, sim: pbd.Simulation) -> None:
    """Both make the step that comes next; what the iterations move must be the same."""
    c()
    sim.step()
    u = sim._context.u.numpy()
    difference = np.max(np.abs(c.u - u)) / np.max(np.abs(u))
    if not difference < AGREEMENT[sim.model.dtype]:
        sys.exit(f"benchmarks/methods.py: C and ours differ by {difference:.1e} of the displacement")


def compare_with_c(rounds: int) -> None:
    print("Direct: ns per link and Newton iteration (median of", rounds, "rounds); ours/C within each round (median)")
    print(f"{'':>8} {'ropes':>6} {'links':>8} {'C':>8} {'ours':>8} {'ours/C':>7}")
    for dtype, real in (("float64", "double"), ("float32", "float")):
        library = compile_c("elimination.c", f"-DREAL={real}")
        for ropes, links in ROPES:
            sim = swinging(ropes, links, dtype)
            c = Elimination(library, sim, ropes, links)
            check_agreement(c, sim)
            work = ITERATIONS * ropes * links
            repeats = max(1, 300_000 // work)
            calls = {"C": c, "ours": sim.step}
            for call in calls.values():
                timed(call, max(1, repeats // 10))
            times = [{name: timed(call, repeats) for name, call in calls.items()} for _ in range(rounds)]
            if sim.iterations_used != ITERATIONS * ropes:
                sys.exit(f"benchmarks/methods.py: ours made {sim.iterations_used / ropes:g} iterations")
            ns = {name: statistics.median(t[name] for t in times) / work * 1e9 for name in calls}
            ratio = statistics.median(t["ours"] / t["C"] for t in times)
            print(f"{dtype:>8} {ropes:>6} {links:>8} {ns['C']:>8.1f} {ns['ours']:>8.1f} {ratio:>7.2f}", flush=True)


@dataclass
class Cost:
    """Of one run to the tolerance."""

    ms: float  # wall clock per simulated second
    iterations: float  # a step
    stretch: float
    unconverged: int  # steps
    failed: bool


def fall(links: int, method: pbd.Direct | pbd.GaussSeidel | pbd.Jacobi) -> Cost:
    """A rope of 1 m, let go from the horizontal."""
    builder = pbd.ModelBuilder()
    t = np.linspace(0.0, 1.0, links + 1)
    builder.add_rope(np.stack([t, 0 * t, 0 * t], axis=1), mass=1.0, pinned=(0,))
    model = builder.finalize(dtype="float64")
    sim = pbd.Simulation(model, dt=1.0 / 60.0, substeps=SUBSTEPS, method=method, on_failure="continue")
    seconds, iterations, stretch, unconverged = 0.0, 0, 0.0, 0
    failed = False
    for _ in range(FRAMES):
        start = time.perf_counter()
        try:
            sim.step()
        except pbd.SimulationFailed:
            failed = True
            break
        seconds += time.perf_counter() - start
        iterations += sim.iterations_used
        unconverged += sim.unconverged
        stretch = max(stretch, pbd.measure(sim).max_stretch)
    frames = max(1, sim.frame)
    return Cost(seconds / (frames * sim.dt) * 1e3, iterations / (frames * SUBSTEPS), stretch, unconverged, failed)


def compare_methods() -> None:
    print(f"\nTo {STRETCH:.1%} stretch: wall ms per simulated second, over {FRAMES / 60:g} s")
    print(f"{'links':>6} {'method':<24} {'ms/s':>9} {'iterations/step':>16} {'max stretch':>12}")
    for links in (100, 1000):
        bounds = {"iterations": 6_000_000 // links, "tolerance": STRETCH / links}
        methods = {
            "direct": pbd.Direct(**bounds),
            "gauss-seidel": pbd.GaussSeidel(**bounds),
            "jacobi": pbd.Jacobi(**bounds),
            "jacobi, relaxation 1.9": pbd.Jacobi(**bounds, relaxation=1.9),
            "jacobi, chebyshev auto": pbd.Jacobi(**bounds, chebyshev="auto"),
        }
        for name, method in methods.items():
            cost = fall(links, method)
            outcome = ""
            if cost.failed:
                outcome = "  diverged"
            elif cost.unconverged:
                outcome = f"  not there in {bounds['iterations']} iterations: {cost.unconverged} steps"
            percent = f"{100.0 * cost.stretch:.2g} %"
            print(f"{links:>6} {name:<24} {cost.ms:>9.1f} {cost.iterations:>16.1f} {percent:>12}{outcome}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, help="rounds of C and ours in turn (9)")
    rounds = parser.parse_args().rounds
    wp.config.log_level = wp.LOG_ERROR
    compare_with_c(rounds)
    compare_methods()


if __name__ == "__main__":
    main()
