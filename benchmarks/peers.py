"""Other simulators beside this one, on the same chains: error against time, each at its own best settings.

    pip install '.[peers]'
    OMP_NUM_THREADS=1 python benchmarks/peers.py [--links 10 50 200] [--scenes chain pendulum hanging] [--out CSV]

A second of 60 frames a second on one core, from rest; the error is the root mean square over particles against the
differential equations (or what the scene's chart has). Each peer's settings are swept: families (methods, integrators,
iterations) times steps a frame, doubled until a second takes longer than --slowest, or for the same error 1000 times as
long as ours, or 8 times as long as another family of the same peer; times are medians. Printed is what each peer's best
settings take within an error, over ours. A peer that is not installed, refuses or fails is named, in the CSV too.
Without --out nothing is written.
"""

import argparse
import importlib.metadata
import os
import statistics
import sys
import time

os.environ["OMP_NUM_THREADS"] = "1"  # before any peer is loaded: one core for all

import numpy as np
import warp as wp
from peer_chains import AUTO, FPS, PEERS

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.accuracy.peers import OURS, PeerRow, front, save
from pbd_warp.accuracy.sweep import provenance

ERRORS = (1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-9)
HOPELESS, BEATEN = 1000.0, 8.0
MOST_DIGITS = 13
ROUNDS_BELOW = 0.5
"""Seconds; what takes longer is measured once."""


def chain(links: int) -> tuple[str, pbd.Model, np.ndarray]:
    builder = pbd.ModelBuilder()
    x = np.linspace([0.0, 0, 0], [1.0, 0, 0], links + 1)
    builder.add_rope(x, mass=np.full(links + 1, 1.0 / links), pinned=(0,))
    model = builder.finalize(dtype="float64")
    return f"chain of {links} links", model, references.chain([1.0], model.x, model.v, model.w, model.gravity)[0][-1]


def charted(name: str) -> tuple[str, pbd.Model, np.ndarray]:
    scene = pbd.load_scene(name)
    return name, scene.builder.finalize(dtype="float64"), scene.reference(1.0)


def sweep(
    peer: str,
    scene: str,
    model: pbd.Model,
    reference: np.ndarray,
    slowest: float,
    rounds: int,
    ours: list[PeerRow],
) -> list[PeerRow]:
    """All families of a peer, each by doublings of its steps; `ours`: the front that they are compared with."""
    nan = float("nan")

    def failure(settings: str, steps: int, error: Exception) -> PeerRow:
        text = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        return PeerRow(scene, peer, settings, steps, nan, nan, nan, text)

    try:
        families = PEERS[peer](model)
    except Exception as error:  # whatever a peer does, the others are measured
        return [failure("", 0, error)]
    rows = []
    for settings, make in families.items():
        best, rises, steps = float("inf"), 0, 1
        while True:
            began = time.process_time()
            try:
                run = make(steps)
                took, x = run()
                repeats = [run()[0] for _ in range(rounds)] if took < ROUNDS_BELOW else [took]
            except Exception as error:
                rows.append(failure(settings, steps, error))
                if not isinstance(error, ArithmeticError | pbd.SimulationFailed):
                    break
                took, failed = time.process_time() - began, True
                ms = 1e3 * took
            else:
                error = float(np.sqrt(np.mean(np.sum((x - reference) ** 2, axis=1))))
                ms = 1e3 * statistics.median(repeats)
                spread = (max(repeats) - min(repeats)) * 1e3 / ms
                rows.append(PeerRow(scene, peer, settings, steps, ms, spread, error, "measured"))
                rises = rises + 1 if error >= best else 0
                best, failed = min(best, error), False
            hopeless = not failed and any(
                row.position_error <= best and ms > factor * row.wall_ms_per_sim_second
                for factor, better in ((HOPELESS, ours), (BEATEN, rows))
                for row in better
            )
            # Round-off, or a floor of the method's own: three doublings that bring nothing are enough.
            if (
                took > slowest / 2.0
                or hopeless
                or (rises >= 3 and best < 1e-2)
                or (settings == AUTO and steps >= MOST_DIGITS)
                or (failed and steps > 4096)
            ):
                break
            steps = steps + 1 if settings == AUTO else 2 * steps
    return rows


def compare(rows: list[PeerRow], scene: str) -> None:
    peers = [p for p in PEERS if any(r.peer == p and r.scene == scene for r in rows)]
    print(f"\n{scene}: ms a simulated second within an error, over {OURS}")
    for error in ERRORS:
        within = {p: next((r for r in front(tuple(rows), scene, p) if r.position_error <= error), None) for p in peers}
        mine = within.get(OURS)
        cells = []
        for peer, row in within.items():
            over = f" ({row.wall_ms_per_sim_second / mine.wall_ms_per_sim_second:.1f}x)" if row and mine else ""
            what = f"{row.wall_ms_per_sim_second:.3g}{over} [{row.settings}, {row.steps}]" if row else "none"
            cells.append(f"{peer}: {what}")
        print(f"  {error:.0e}  " + ";  ".join(cells))
    for row in rows:
        if row.scene == scene and row.outcome != "measured":
            print(f"  {row.peer}, {row.settings}, {row.steps} steps: {row.outcome}")


def versions() -> str:
    names = {"pyelastica": "pyelastica", "pypbd": "pyPBD", "mujoco": "mujoco", "newton": "newton"}
    found = []
    for name, package in names.items():
        try:
            found.append(f"{name} {importlib.metadata.version(package)}")
        except importlib.metadata.PackageNotFoundError:
            found.append(f"{name} not installed")
    return ", ".join(found)


def main() -> None:
    if os.environ.get("OMP_NUM_THREADS") != "1":
        raise SystemExit("set OMP_NUM_THREADS=1 first: one core for all")
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--links", type=int, nargs="*", default=[10, 50, 200])
    parser.add_argument("--scenes", nargs="*", default=["chain", "pendulum", "hanging"])
    parser.add_argument("--peers", nargs="*", default=list(PEERS), choices=list(PEERS))
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--slowest", type=float, default=8.0, help="seconds for a simulated one")
    parser.add_argument("--out")
    given = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    rows: list[PeerRow] = []
    cases = [charted(name) for name in given.scenes] + [chain(links) for links in given.links]
    for scene, model, reference in cases:
        for peer in given.peers:
            print(f"{time.strftime('%X')} {scene}, {peer}", file=sys.stderr)
            rows += sweep(peer, scene, model, reference, given.slowest, given.rounds, front(tuple(rows), scene, OURS))
        compare(rows, scene)
    if given.out:
        made = provenance(model.device)
        info = {
            "measured": f"{FPS} frames at {FPS} frames/s, {given.rounds} repetitions, median, swept up to "
            f"{given.slowest:g} s a simulated second",
            **made,
            "versions": f"{made['versions']}, {versions()}",
        }
        save(rows, info, given.out)


if __name__ == "__main__":
    main()
