"""What a constraint and iteration costs: captured, uncaptured, and beside plain C in the same run.

    python benchmarks/step.py

Chains of 33, 1000 and 100 000 particles, 20 Jacobi iterations, float32, one step a frame. The C loop (scatter.c,
compiled by `gcc -O3 -march=native -ffast-math`) makes the 20 sweeps; the simulation makes the whole step. The three are
timed in turn, round by round, and each is given by its median, so that a drifting clock does not favour one.
"""

import argparse
import ctypes
import statistics

import numpy as np
import warp as wp
from plain_c import compile_c, timed

import pbd_warp as pbd

ITERATIONS = 20
SIZES = (33, 1000, 100_000)


def chain(n: int) -> pbd.Model:
    """Hangs between its fixed first particle and the floor of nothing: bent, so that no correction vanishes."""
    builder = pbd.ModelBuilder()
    t = np.arange(n) * 0.1
    builder.add_rope(np.stack([t, 0.02 * np.sin(9.0 * t), 0 * t], axis=1), mass=0.01 * n, pinned=(0,))
    return builder.finalize()


def c_sweeps(library: ctypes.CDLL, model: pbd.Model):
    """A function that makes the sweeps of one step in C."""
    edge, n = model.distance.edge, model.particle_count
    share = np.zeros(n, np.int32)
    model.distance.valence(share)
    arrays = [
        np.ascontiguousarray(a)
        for a in (edge, np.float32(model.distance.rest_length), np.float32(model.x), np.float32(model.w), share)
    ]
    u, correction = np.zeros((n, 3), np.float32), np.zeros((n, 3), np.float32)
    u[:, 1] = -0.0027
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in arrays]
    out = [ctypes.c_void_p(a.ctypes.data) for a in (u, correction)]
    keep = (arrays, u, correction)

    def call(_keep=keep):
        library.sweep(len(edge), n, ITERATIONS, *pointers, ctypes.c_float(1.0), *out)

    return call


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15, help="rounds of the three in turn (15)")
    rounds = parser.parse_args().rounds
    wp.config.log_level = wp.LOG_ERROR
    library = compile_c("scatter.c")
    print("ns per constraint and iteration (median of", rounds, "rounds); ratios within each round (median)")
    print(
        f"{'particles':>9} {'C':>8} {'captured':>9} {'uncaptured':>11} {'captured/C':>11} {'uncaptured/captured':>20}"
    )
    for n in SIZES:
        model = chain(n)
        method = pbd.Jacobi(ITERATIONS)
        captured = pbd.Simulation(model, method=method)
        launched = pbd.Simulation(model, method=method, capture=False)
        work = ITERATIONS * (n - 1)
        repeats = max(1, 1_000_000 // work)
        calls = {
            "C": (c_sweeps(library, model), repeats),
            "captured": (captured.step, repeats),
            "uncaptured": (launched.step, max(1, repeats // 20)),
        }
        for call, count in calls.values():
            timed(call, max(1, count // 10))
        times = [{name: timed(*call) for name, call in calls.items()} for _ in range(rounds)]
        ns = {name: statistics.median(t[name] for t in times) / work * 1e9 for name in calls}
        ratio_c = statistics.median(t["captured"] / t["C"] for t in times)
        ratio_launch = statistics.median(t["uncaptured"] / t["captured"] for t in times)
        print(
            f"{n:>9} {ns['C']:>8.1f} {ns['captured']:>9.1f} {ns['uncaptured']:>11.1f} "
            f"{ratio_c:>11.2f} {ratio_launch:>20.1f}"
        )


if __name__ == "__main__":
    main()
