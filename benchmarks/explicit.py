"""The explicit integrator beside the classical Runge-Kutta method in plain C, at equal error; and what a link costs.

    python benchmarks/explicit.py [--rounds 7]

Needs gcc and SciPy; takes about half a minute. Chains of 1 m and 1 kg fall from the horizontal for a second, float64,
60 frames a second on one core; the error is the root mean square over particles against the differential equations.

1. Error and milliseconds a simulated second of ours ("auto", at several `error`) and of C (chain_rk4.c, compiled by
   `gcc -O3 -march=native -ffast-math`; equal steps, from 1 a frame up by doublings). "over C" is ours over what C takes
   for the same error, interpolated in logarithms between C's two nearest; where C's round-off ends before, its last.
   Rounds of both in turn, the median of each.
2. Nanoseconds a link and solution (12 stages and 2 projections are 14 a step) for 50, 500 and 5000 links.
"""

import argparse
import ctypes
import statistics
import time

import numpy as np
import warp as wp
from plain_c import compile_c

import pbd_warp as pbd
from pbd_warp.accuracy import references

FPS = 60
ASKED = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
C_STEPS = tuple(2**k for k in range(10))


def chain(links: int) -> pbd.Model:
    builder = pbd.ModelBuilder()
    x = np.linspace([0.0, 0, 0], [1.0, 0, 0], links + 1)
    builder.add_rope(x, mass=np.full(links + 1, 1.0 / links), pinned=(0,))
    return builder.finalize(dtype="float64")


class Ours:
    """A second of frames; `sim.step` from Python, as one would."""

    def __init__(self, model: pbd.Model, dt: float = 1.0 / FPS, **settings):
        self._sim = pbd.Simulation(model, dt=dt, integrator="dop853", **settings)

    def __call__(self, frames: int = FPS) -> tuple[float, np.ndarray]:
        """Seconds it takes, and the positions at the end."""
        sim = self._sim
        sim.reset()
        start = time.perf_counter()
        for _ in range(frames):
            sim.step()
        return time.perf_counter() - start, sim.state.x.numpy()


class PlainC:
    """The same in C."""

    def __init__(self, library: ctypes.CDLL, model: pbd.Model, steps: int):
        self._library, self._model, self._steps = library, model, steps
        self._scratch = np.empty(20 * model.particle_count)

    def __call__(self) -> tuple[float, np.ndarray]:
        m = self._model
        x, v = m.x.copy(), m.v.copy()
        arrays = (m.gravity, m.w, m.distance.rest_length, x, v, self._scratch)
        arguments = [ctypes.c_void_p(np.ascontiguousarray(a).ctypes.data) for a in arrays]
        h = ctypes.c_double(1.0 / (FPS * self._steps))
        start = time.perf_counter()
        for _ in range(FPS):
            self._library.chain_rk4(m.particle_count, self._steps, h, *arguments)
        return time.perf_counter() - start, x


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    rounds = parser.parse_args().rounds
    wp.config.log_level = wp.LOG_ERROR
    library = compile_c("chain_rk4.c")
    print(f"{'links':>5} {'error asked':>12} {'error':>9} {'ms':>8} {'C, ms':>8} {'over C':>7}")
    for links in (10, 50, 200):
        model = chain(links)
        reference = references.chain([1.0], model.x, model.v, model.w, model.gravity)[0][-1]
        ours = [Ours(model, substeps="auto", error=asked) for asked in ASKED]
        c = [PlainC(library, model, steps) for steps in C_STEPS]
        runs = [[run() for run in [*ours, *c]] for _ in range(rounds)]
        ms = [1e3 * statistics.median(r[k][0] for r in runs) for k in range(len(runs[0]))]
        error = [float(np.sqrt(np.mean(np.sum((x - reference) ** 2, axis=1)))) for _, x in runs[0]]
        useful = [k for k in range(len(ours), len(ms)) if np.isfinite(error[k]) and error[k] < 1e-2]
        curve = sorted((np.log(error[k]), np.log(ms[k])) for k in useful)
        for asked, e, t in zip(ASKED, error, ms, strict=False):
            plain = float(np.exp(np.interp(np.log(e), *zip(*curve, strict=True))))
            print(f"{links:5d} {asked:12.0e} {e:9.1e} {t:8.3f} {plain:8.3f} {t / plain:7.2f}")
    print(f"\n{'links':>5} {'ns a link and solution':>23}")
    for links in (50, 500, 5000):
        frames = 20 if links < 5000 else 2
        run = Ours(chain(links), 1.0 / FPS * 50.0 / links, substeps=8)
        seconds = statistics.median(run(frames)[0] for _ in range(rounds))
        print(f"{links:5d} {1e9 * seconds / (frames * 8 * 14 * links):23.1f}")


if __name__ == "__main__":
    main()
