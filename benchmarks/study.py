"""What studies cost, and what they gain: on many cores, with many small simulations in one, through Dask.

    python benchmarks/study.py                  # all, some minutes
    python benchmarks/study.py replicate dask   # some of: atlas, replicate, dask, rows, kills

atlas: maps of the stability atlas in this process, then by two workers. replicate: 10 000 chains of 20 links for a
second, as copies in one simulation; one simulation alone times 10 000 beside it, and C's limit: the bare sweeps in C
(scatter.c), without anything around them. dask: time of rows that take 1 ms, in batches, over the work itself. rows:
what a row of a study costs, to its file. kills: a study killed at random moments and started again, and whether a row
that was kept is there in the end.
"""

import argparse
import ctypes
import os
import random
import subprocess
import sys
import tempfile
import time
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import warp as wp
from plain_c import compile_c

import pbd_warp as pbd
from pbd_warp.stability.atlas import measure_maps
from pbd_warp.stability.maps import MAPS
from pbd_warp.study.grid import Grid
from pbd_warp.study.store import load
from pbd_warp.study.study import make_runs, run_study
from pbd_warp.workers import ThisProcess, open_pool

WORKERS = 2
COPIES, LINKS, FRAMES = 10_000, 20, 60
KILLS = 20


def seconds(call) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def atlas(names: list[str]) -> None:
    maps = [MAPS[name] for name in names or MAPS]
    with open_pool(WORKERS) as pool:

        def measure_by(who):
            start, found = time.perf_counter(), {}
            for measured in measure_maps(maps, pool=who):
                found[measured.map.name] = measured.cells
            return time.perf_counter() - start, found

        for who in (ThisProcess(), pool):  # kernels are loaded, and compiled if need be
            list(measure_maps([MAPS["coincident"]], pool=who))
        here, cells = measure_by(ThisProcess())
        there, same = measure_by(pool)
        assert cells == same
        count = sum(map(len, cells.values()))
        print(f"atlas: {count} cells, {here:.1f} s here, {there:.1f} s by {WORKERS}: {here / there:.2f} times as fast")


def chain() -> pbd.ModelBuilder:
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], LINKS + 1), mass=1.0)
    return builder


def replicate() -> None:
    rng = np.random.default_rng(1)
    for name, settings in (
        ("jacobi, 10 iterations, 4 substeps", {"method": pbd.Jacobi(10), "substeps": 4}),
        ("gauss-seidel, 10 iterations, 4 substeps", {"method": pbd.GaussSeidel(10), "substeps": 4}),
        ("direct, midpoint, 2 substeps", {"method": pbd.Direct(), "integrator": "midpoint", "substeps": 2}),
    ):
        settings["limits"] = pbd.Limits(stretch=None)
        alone = pbd.Simulation(chain().finalize(), **settings)
        alone.step()

        def run_alone(sim=alone):
            sim.reset()
            for _ in range(FRAMES):
                sim.step()

        of_one = min(seconds(run_alone) for _ in range(3))
        start = time.perf_counter()
        mass = rng.uniform(0.5, 2.0, (COPIES, 1))
        sim = pbd.Simulation(chain().replicate(COPIES, mass=mass * np.ones(LINKS + 1)).finalize(), **settings)
        built = time.perf_counter()
        for _ in range(FRAMES):
            sim.step()
        stretch = pbd.measure_copies(sim).max_stretch
        total = time.perf_counter() - start
        line = f"  {name}: {total:.1f} s ({built - start:.1f} s of it to build), {len(sim.failures)} diverged, "
        line += f"stretch up to {np.nanmax(stretch):.2g}; one by one {COPIES * of_one:.0f} s without building"
        if isinstance(settings["method"], pbd.Jacobi):
            line += f"; C's limit {c_limit(sim.model, 10 * 4 * FRAMES):.1f} s"
        print(line)
        print(f"replicate: {COPIES} runs in {total:.1f} s")


def c_limit(model: pbd.Model, sweeps: int) -> float:
    """So many sweeps over a model in C, of which a tenth is measured."""
    library = compile_c("scatter.c")
    share = np.zeros(model.particle_count, np.int32)
    model.distance.valence(share)
    arrays = [
        np.ascontiguousarray(a)
        for a in (model.distance.edge, *map(np.float32, (model.distance.rest_length, model.x, model.w)), share)
    ]
    out = [np.zeros((model.particle_count, 3), np.float32) for _ in range(2)]
    pointers = [ctypes.c_void_p(a.ctypes.data) for a in (*arrays,)]
    results = [ctypes.c_void_p(a.ctypes.data) for a in out]
    part = max(1, sweeps // 10)
    return (
        sweeps
        / part
        * seconds(
            lambda: library.sweep(
                len(model.distance), model.particle_count, part, *pointers, ctypes.c_float(1.0), *results
            )
        )
    )


def busy(items):
    """1 ms of work an item."""
    for _ in items:
        until = time.perf_counter() + 1e-3
        while time.perf_counter() < until:
            pass
    return items


def dask() -> None:
    count = 20_000
    with open_pool(WORKERS) as pool:
        list(pool.run(busy, list(range(200)), lambda: None))
        took = seconds(lambda: list(pool.run(busy, list(range(count)), lambda: None)))
        print(f"dask: {1e3 * (took * WORKERS / count - 1e-3):.3f} ms a row over the work itself, on a worker's core")


SCENE = """
import numpy as np
import pbd_warp as pbd

def scene(seed: int = 0, drag: bool = True):
    builder = pbd.ModelBuilder()
    z = np.random.default_rng(seed).normal(0.0, 0.01, 21)
    builder.add_rope(np.stack([np.linspace(0.0, 1.0, 21), 0 * z, z], axis=1))
    # Runs with a drag are made each by itself.
    return pbd.Scene(builder, frames=60, drag=[(0.0, "select", 20)] if drag else [])
"""


def kills(rows: int) -> None:
    rng = random.Random(1)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "own.py").write_text(SCENE)
        out = Path(folder) / "s.parquet"
        journal = out.with_name("s.parquet.rows")
        command = [sys.executable, "-c", "from pbd_warp.cli import main; main()", "study", "own.py"]
        command += ["--seed", f"0..{rows - 1}", "--measure", "energy,tip", "--out", str(out), "--workers", str(WORKERS)]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
        kept: dict[int, bytes] = {}
        for _ in range(KILLS):
            process = subprocess.Popen(command, **quiet)
            before = len(kept)
            until = time.monotonic() + 60.0
            # From the start of its workers on, at a random moment.
            while process.poll() is None and time.monotonic() < until and len(kept) == before:
                time.sleep(0.05)
                kept |= _lines(journal)
            time.sleep(rng.uniform(0.0, 1.0))
            process.kill()
            process.wait()
            now = _lines(journal)
            assert all(now.get(number) == line for number, line in kept.items()), "a row is lost"
            kept |= now
        assert len(kept) < rows, f"too few rows for {KILLS} kills: only the first of them met a study under way"
        assert subprocess.run(command, **quiet).returncode == 0
        frame = load(out)
        assert sorted(frame["row"]) == list(range(rows))
        print(f"kills: {KILLS} kills, {len(kept)} rows kept through them, none lost, {rows} in the end")


def rows() -> None:
    """A whole study, to its file: what a row costs, where all are copies and where each is run by itself."""
    count = 4000
    with tempfile.TemporaryDirectory() as folder:
        own = Path(folder) / "own.py"
        own.write_text(SCENE)
        for drag, how in ((False, "as copies"), (True, "each by itself")):
            out = Path(folder) / f"{how}.parquet"
            with open_pool(WORKERS) as pool:
                runs = make_runs(
                    str(own), {"drag": [drag]}, ["energy", "tip"], range(count), {}, None, "float32", None, False
                )
                run_study(replace(runs, grid=Grid({"drag": (drag,), "seed": (0,)})), None, lambda: nullcontext(pool))
                took = seconds(partial(run_study, runs, out, lambda pool=pool: nullcontext(pool)))
            size = out.stat().st_size / count
            print(
                f"rows, {how}: {1e3 * took / count:.2f} ms a row with {WORKERS} workers, {size:.0f} bytes in the file"
            )
    with open_pool(WORKERS) as pool:
        tasks = 2000
        took = seconds(lambda: [pool._client.submit(int, k, pure=False) for k in range(tasks)][-1].result())
        print(f"rows: {tasks / took:.0f} empty tasks a second through the scheduler")


def _lines(journal: Path) -> dict[int, bytes]:
    """Whole lines of a journal by the number of their row."""
    import json

    if not journal.exists():
        return {}
    lines = journal.read_bytes().split(b"\n")[1:-1]
    return {json.loads(line)["row"]: line for line in lines}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", nargs="*", default=["atlas", "replicate", "dask", "rows", "kills"])
    parser.add_argument("--maps", default="", help="of the atlas, comma-separated; all unless given")
    parser.add_argument("--rows", type=int, default=20_000, help="of the study that is killed (20000)")
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    for what in given.what:
        if what == "atlas":
            atlas([name for name in given.maps.split(",") if name])
        elif what == "kills":
            kills(given.rows)
        else:
            {"replicate": replicate, "dask": dask, "rows": rows}[what]()


if __name__ == "__main__":
    main()
