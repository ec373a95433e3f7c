"""What a constraint and iteration costs: in one launch, launched from Python, and beside plain C in the same run.

    python benchmarks/step.py

Chains of 33, 1000 and 100 000 particles, 20 Jacobi iterations, float32, one step a frame. The C loop (scatter.c,
compiled by `gcc -O3 -march=native -ffast-math`) makes the 20 sweeps, as our kernels do and as fast as plain C makes
them here ("best C"); the simulation makes the whole step. All are timed in turn, round by round, and each is given by
its median, so that a drifting clock does not favour one.
"""

import argparse
import ctypes
import statistics
import sys

import numpy as np
import warp as wp
from plain_c import compile_c, timed

import pbd_warp as pbd

ITERATIONS = 20
SIZES = (33, 1000, 100_000)

NEVER = pbd.Limits(stretch=1e9)
"""20 sweeps let such chains stretch a lot."""


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

    return call, u


def c_gather(library: ctypes.CDLL, model: pbd.Model):
    """The same sweeps, as fast as plain C makes them."""
    edge, n = model.distance.edge.astype(np.int32), model.particle_count
    m = len(edge)
    share = np.zeros(n, np.int32)
    model.distance.valence(share)
    width = int(share.max())
    slot, sign = np.full((width, n), m, np.int32), np.zeros((width, n), np.float32)
    filled = np.zeros(n, int)
    for k, ends in enumerate(edge.tolist()):
        for particle, side in zip(ends, (1.0, -1.0), strict=True):
            slot[filled[particle], particle], sign[filled[particle], particle] = k, side
            filled[particle] += 1
    weight = share * model.w
    i, j = edge.T
    x = np.float32(model.x)
    arrays = [
        np.ascontiguousarray(i),
        np.ascontiguousarray(j),
        np.float32(model.distance.rest_length),
        np.ascontiguousarray((x[i] - x[j]).T),
        np.float32(1.0 / (weight[i] + weight[j])),
        np.float32(model.w),
        slot,
        sign,
        np.zeros((3, n), np.float32),
        np.zeros((3, m + 1), np.float32),
    ]
    arrays[-2][1] = -0.0027
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in arrays]

    def call(_keep=arrays):
        library.sweep_gather(m, n, ITERATIONS, width, *pointers)

    return call, arrays


def check_agreement(scatter, gather, u_scatter: np.ndarray, u_gather: np.ndarray, extent: float) -> None:
    """Both C loops move the particles to the same place, to the rounding of positions in a chain of that extent [m]:
    -ffast-math lets the first one add them up in another order than ours."""
    scatter()
    gather()
    apart = np.abs(u_scatter - u_gather.T).max()
    if not apart < np.finfo(np.float32).eps * max(extent, 8.0):
        sys.exit(f"benchmarks/step.py: the two C loops are {apart:.1e} m apart")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=15, help="rounds of all in turn (15)")
    rounds = parser.parse_args().rounds
    wp.config.log_level = wp.LOG_ERROR
    library = compile_c("scatter.c")
    print("ns per constraint and iteration (median of", rounds, "rounds); ratios within each round (median)")
    print(
        f"{'particles':>9} {'C':>8} {'best C':>8} {'fused':>8} {'uncaptured':>11} {'fused/C':>8} {'fused/best C':>13} "
        f"{'uncaptured/fused':>17}"
    )
    for n in SIZES:
        model = chain(n)
        method = pbd.Jacobi(ITERATIONS)
        fused = pbd.Simulation(model, method=method, limits=NEVER)
        launched = pbd.Simulation(model, method=method, limits=NEVER, capture=False)
        work = ITERATIONS * (n - 1)
        repeats = max(1, 1_000_000 // work)
        scatter, u = c_sweeps(library, model)
        gather, arrays = c_gather(library, model)
        check_agreement(scatter, gather, u, arrays[-2], float(np.ptp(model.x[:, 0])))
        calls = {
            "C": (scatter, repeats),
            "gather": (gather, repeats),
            "fused": (fused.step, repeats),
            "uncaptured": (launched.step, max(1, repeats // 20)),
        }
        for call, count in calls.values():
            timed(call, max(1, count // 10))
        times = [{name: timed(*call) for name, call in calls.items()} for _ in range(rounds)]
        ns = {name: statistics.median(t[name] for t in times) / work * 1e9 for name in calls}
        ratio_best = statistics.median(t["fused"] / t["gather"] for t in times)
        ratio_c = statistics.median(t["fused"] / t["C"] for t in times)
        ratio_launch = statistics.median(t["uncaptured"] / t["fused"] for t in times)
        print(
            f"{n:>9} {ns['C']:>8.1f} {ns['gather']:>8.1f} {ns['fused']:>8.1f} {ns['uncaptured']:>11.1f} "
            f"{ratio_c:>8.2f} {ratio_best:>13.2f} {ratio_launch:>17.1f}"
        )


if __name__ == "__main__":
    main()
