"""What whole frames cost: in one launch, replayed launch by launch, and beside plain C of the same frame.

    python benchmarks/frames.py

1. rope, worm and point: a frame in C (frame.c, compiled by `gcc -O3 -march=native -ffast-math`), fused, 20 fused
   ones in one call, and replayed. All begin at the same moment of the scene, in its swing; all are timed in turn,
   round by round, and each is given by its median. That C and ours arrive at the same place is checked first.
2. collision: no C, but microseconds.
3. Where a grid begins to pay: a frame of spheres in a box, each pair looked at, and with a grid.
4. Whether launches ever pay on this device: ropes of 100 links, fused and replayed.
5. A frame of `Direct`, which is replayed: what as many launches that do nothing take of it is what one launch for all
   of it would save at most; and one of "dop853", which is a launch already.
6. What compiling takes from nothing, fused and launch by launch, each in a process of its own.

float32. A library that gcc made with -ffast-math flushes denormal numbers to zero in the whole process, ours too.
"""

import argparse
import ctypes
import os
import statistics
import subprocess
import sys
import tempfile

import numpy as np
import warp as wp
from plain_c import compile_c, timed

import pbd_warp as pbd
from pbd_warp.step import program
from pbd_warp.step.constraints import contact
from pbd_warp.step.methods.gauss_seidel import colours

START = 60
"""Frames before the first one that is timed: the rope has begun to swing."""

AGREEMENT = 1e-4
"""How far ours and C may lie apart after a frame [m], in float32."""

REPEATS = 20


class PlainFrame:
    """The same frame in C, from where a simulation is."""

    def __init__(self, library: ctypes.CDLL, sim: pbd.Simulation):
        model, settings = sim.model, sim.settings
        edge = model.distance.edge
        method = settings.method
        self._jacobi = isinstance(method, pbd.Jacobi)
        order = np.arange(len(edge)) if self._jacobi else np.concatenate(colours(edge))
        share = np.zeros(model.particle_count, np.int32)
        model.distance.valence(share)
        model.point.valence(share)
        self.x, self.v = sim.state.x.numpy().copy(), sim.state.v.numpy().copy()
        self._arrays = [
            np.ascontiguousarray(edge[order].astype(np.int32)),
            np.float32(model.distance.rest_length[order]),
            np.float32(model.w),
            share,
            self.x,
            self.v,
            np.zeros_like(self.x),
            np.zeros_like(self.x),
        ]
        fraction = 1.0 - (1.0 - settings.damping) ** (1.0 / settings.substeps)
        locked = int(model.point.particle[0]) if len(model.point) else -1
        self._arguments = (
            *(model.particle_count, len(edge), settings.substeps, method.iterations if self._jacobi else 0),
            *(ctypes.c_void_p(a.ctypes.data) for a in self._arrays[:4]),
            *(ctypes.c_float(settings.step_dt), ctypes.c_float(model.gravity[1]), ctypes.c_float(fraction), locked),
            *(ctypes.c_void_p(a.ctypes.data) for a in self._arrays[4:]),
        )
        self._library = library

    def __call__(self) -> None:
        self._library.frame(*self._arguments)


def replayed(model: pbd.Model, settings: pbd.Settings) -> pbd.Simulation:
    """A simulation whose frames are replayed launch by launch."""
    pays = program.Program.pays
    program.Program.pays = lambda *_: False
    try:
        return pbd.Simulation(model, settings)
    finally:
        program.Program.pays = pays


def set_state(sim: pbd.Simulation, x: np.ndarray, v: np.ndarray) -> pbd.Simulation:
    sim.state.x.assign(x)
    sim.state.v.assign(v)
    return sim


def compare_with_c(rounds: int) -> None:
    library = compile_c("frame.c")
    print(f"us a frame (median of {rounds} rounds); ratios to C within each round (median)")
    print(f"{'scene':>10} {'C':>8} {'fused':>8} {'20 a call':>10} {'replayed':>9} {'fused/C':>8} {'20 a call/C':>12}")
    for name in ("rope", "worm", "point"):
        scene = pbd.load_scene(name)
        model, settings = scene.builder.finalize(dtype="float32"), scene.settings
        sims = [pbd.Simulation(model, settings), pbd.Simulation(model, settings), replayed(model, settings)]
        first = sims[0]
        if name == "worm":  # the drag would lead it
            v = np.zeros((model.particle_count, 3))
            v[:, 1] = 0.3 * np.sin(np.arange(model.particle_count))
            first.state.v.assign(v)
        elif name == "point":
            v = np.zeros((model.particle_count, 3))
            v[-1, 1] = 1.0
            first.state.v.assign(v)
        first.step(frames=START if name == "rope" else 5)
        start = first.state.x.numpy().copy(), first.state.v.numpy().copy()
        fused, many, launches = (set_state(sim, *start) for sim in sims)
        c = PlainFrame(library, fused)
        c()
        fused.step()
        apart = np.abs(c.x - fused.state.x.numpy()).max()
        if not apart < AGREEMENT:
            sys.exit(f"benchmarks/frames.py: {name}: C and ours are {apart:.1e} m apart after a frame")
        calls = {
            "C": (c, REPEATS),
            "fused": (fused.step, REPEATS),
            "many": (lambda many=many: many.step(frames=REPEATS), 1),
            "replayed": (launches.step, REPEATS),
        }
        for call, count in calls.values():
            timed(call, count)
        times = []
        for _ in range(rounds):
            for sim in (fused, many, launches):
                set_state(sim, *start)
            c.x[:], c.v[:] = start
            times.append({n: timed(call, count) for n, (call, count) in calls.items()})
            times[-1]["many"] /= REPEATS
        us = {n: statistics.median(t[n] for t in times) * 1e6 for n in calls}
        ratio = {n: statistics.median(t[n] / t["C"] for t in times) for n in calls}
        print(
            f"{name:>10} {us['C']:>8.1f} {us['fused']:>8.1f} {us['many']:>10.1f} {us['replayed']:>9.1f} "
            f"{ratio['fused']:>8.2f} {ratio['many']:>12.2f}"
        )


def collision(rounds: int) -> None:
    scene = pbd.load_scene("collision")
    sim = pbd.Simulation(scene.builder.finalize(dtype="float32"), scene.settings)
    sim.step(frames=START)
    us = statistics.median(timed(sim.step, REPEATS) for _ in range(rounds)) * 1e6
    print(f"\ncollision: {us:.0f} us a frame of {len(sim.passes) * sim.substeps} passes, fused: {sim.fused}")


def spheres(n: int) -> pbd.Model:
    """A third of a box full of spheres that move slowly, on a jittered lattice."""
    rng = np.random.default_rng(0)
    side = int(np.ceil(n ** (1.0 / 3.0)))
    lattice = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:n]
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles(lattice + rng.uniform(-0.1, 0.1, (n, 3)), rng.normal(size=(n, 3)), 1.0, 0.45)
    builder.enable_contacts()
    return builder.finalize(dtype="float32")


def compare_grids(rounds: int) -> None:
    print("\nus a step of spheres, 1 Jacobi sweep (median): each pair looked at, and with a grid")
    print(f"{'particles':>10} {'pairs':>8} {'grid':>8}")
    limit = contact.WITHOUT_GRID
    settings = pbd.Settings(method=pbd.Jacobi(1), dt=1e-3)
    for n in (35, 100, 200, 300, 400, 600, 800, 1200):
        sims = {}
        for name, contact.WITHOUT_GRID in (("pairs", n), ("grid", 0)):
            sims[name] = pbd.Simulation(spheres(n), settings)
        contact.WITHOUT_GRID = limit
        times = [{name: timed(sim.step, 5) for name, sim in sims.items()} for _ in range(rounds)]
        us = {name: statistics.median(t[name] for t in times) * 1e6 for name in sims}
        print(f"{n:>10} {us['pairs']:>8.0f} {us['grid']:>8.0f}")


def compare_sizes(rounds: int) -> None:
    print("\nus a frame of ropes, 4 substeps of 5 Jacobi sweeps (median): fused, and replayed launch by launch")
    print(f"{'particles':>10} {'fused':>10} {'replayed':>10} {'ratio':>6}")
    settings = pbd.Settings(method=pbd.Jacobi(5), substeps=4, damping=0.1, limits=pbd.Limits(stretch=None))
    for ropes in (1, 10, 100, 1000):
        builder = pbd.ModelBuilder()
        for z in range(ropes):
            builder.add_rope(np.linspace([0, 0, z], [1, 0, z], 101), pinned=(0,))
        model = builder.finalize(dtype="float32")
        sims = {"fused": pbd.Simulation(model, settings), "replayed": replayed(model, settings)}
        count = max(1, 100 // ropes)
        times = [{name: timed(sim.step, count) for name, sim in sims.items()} for _ in range(rounds)]
        us = {name: statistics.median(t[name] for t in times) * 1e6 for name in sims}
        ratio = statistics.median(t["fused"] / t["replayed"] for t in times)
        print(f"{model.particle_count:>10} {us['fused']:>10.0f} {us['replayed']:>10.0f} {ratio:>6.2f}")


@wp.kernel(enable_backward=False)
def nothing(a: wp.array[wp.int32]):
    a[0] = 0


def direct(rounds: int) -> None:
    print("\nus a frame of a chain, 4 substeps (median); empty: as many launches of nothing, replayed")
    print(f"{'links':>6} {'launches':>9} {'direct':>8} {'empty':>7} {'part':>6} {'dop853':>8}")
    a = wp.zeros(1, dtype=wp.int32)
    wp.load_module(__name__)
    for links in (10, 50, 500):
        builder = pbd.ModelBuilder()
        builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], links + 1), pinned=(0,))
        model = builder.finalize(dtype="float64")
        sim = pbd.Simulation(model, method=pbd.Direct(), integrator="bdf2", substeps=4, on_failure="continue")
        explicit = pbd.Simulation(model, integrator="dop853", substeps=4, on_failure="continue", dt=1e-3)
        with wp.ScopedCapture() as capture:
            for _ in range(sim.launches):
                wp.launch(nothing, 1, inputs=[a])
        calls = {"direct": sim.step, "empty": lambda c=capture: wp.capture_launch(c.graph), "dop853": explicit.step}
        times = [{name: timed(call, 20) for name, call in calls.items()} for _ in range(rounds)]
        us = {name: statistics.median(t[name] for t in times) * 1e6 for name in calls}
        part = us["empty"] / us["direct"]
        print(
            f"{links:>6} {sim.launches:>9} {us['direct']:>8.1f} {us['empty']:>7.1f} {100 * part:>4.0f} % "
            f"{us['dop853']:>8.1f}"
        )


COMPILE = """
import sys, time, warp as wp, pbd_warp as pbd
wp.config.log_level = wp.LOG_ERROR
scene, how = pbd.load_scene(sys.argv[1]), sys.argv[2]
model = scene.builder.finalize(dtype="float32")
settings = scene.settings.changed(integrator="dop853") if how == "dop853" else scene.settings
start = time.process_time()
sim = pbd.Simulation(model, settings, capture=how != "launches")
assert sim.fused == (how == "fused")
print(time.process_time() - start)
"""


def compile_times() -> None:
    def seconds(scene: str, how: str) -> float:
        with tempfile.TemporaryDirectory() as cache:
            command = [sys.executable, "-c", COMPILE, scene, how]
            env = {**os.environ, "WARP_CACHE_PATH": cache}
            return float(
                subprocess.run(command, env=env, capture_output=True, text=True, check=True).stdout.split()[-1]
            )

    print("\nseconds of CPU to build a simulation, compiling from nothing")
    print(f"{'scene':>10} {'fused':>7} {'launches':>9} {'ratio':>6}")
    for scene in ("rope", "worm", "point", "collision"):
        fused, launches = seconds(scene, "fused"), seconds(scene, "launches")
        print(f"{scene:>10} {fused:>7.2f} {launches:>9.2f} {fused / launches:>6.2f}")
    print(f"{'chain':>10} {seconds('chain', 'dop853'):>7.2f} by dop853")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, help="rounds of all in turn (9)")
    rounds = parser.parse_args().rounds
    wp.config.log_level = wp.LOG_ERROR
    compare_with_c(rounds)
    collision(rounds)
    compare_grids(rounds)
    compare_sizes(rounds)
    direct(rounds)
    compile_times()


if __name__ == "__main__":
    main()
