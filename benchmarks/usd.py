"""What writing a frame costs, beside simulating it and beside warp.render.UsdRenderer; and the memory of long runs.

    python benchmarks/usd.py

A rope of 10 000 particles, float32, 20 Jacobi iterations a frame. Our file has particles and rope, each with points,
velocities and extents: 20 000 points; a second one has the particles alone, 10 000. It survives a kill while it grows,
and is synced to the disk. UsdRenderer's have the points (as UsdGeom.Points), and in a second one the links as well, as
capsules; they are in memory until they are saved. What the disk itself takes is measured with plain files of as many
bytes as our first: one for 32 frames each, synced, then one for all, synced, then the first ones removed. Everything is
timed in turn, frame by frame, in rounds of 96 frames; what the end of a file costs (our merging, the renderer's saving)
is shared out among its frames. Ratios are taken within each round.

The memory is the peak of resident memory of processes that write 300 and 3000 frames of the same rope.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import warp as wp
import warp.render
from plain_c import timed

import pbd_warp as pbd
from pbd_warp.usd.chunks import CHUNK

PARTICLES = 10_000
FRAMES = 96
LINE_FRAMES = 3  # they take so long that a few are enough
MEMORY_FRAMES = (300, 3000)
LIMIT_MS = 1.5
LIMIT_MIB = 40


def rope() -> pbd.Model:
    builder = pbd.ModelBuilder()
    t = np.arange(PARTICLES) * 0.01
    builder.add_rope(np.stack([t, 0.02 * np.sin(9.0 * t), 0 * t], axis=1), mass=1.0, pinned=(0,), radius=0.005)
    return builder.finalize()


def particles(model: pbd.Model) -> pbd.Model:
    """Those of a model, and nothing that joins them."""
    builder = pbd.ModelBuilder()
    builder.add_particles(model.x, radius=model.radius)
    return builder.finalize()


def round_of_all(model: pbd.Model, parent: Path | None) -> dict[str, float]:
    """Milliseconds a frame."""
    with tempfile.TemporaryDirectory(dir=parent) as folder:
        return time_all(model, Path(folder))


def time_all(model: pbd.Model, folder: Path) -> dict[str, float]:
    sim = pbd.Simulation(model, method=pbd.Jacobi(20), limits=pbd.Limits(stretch=None))  # it stretches a lot
    writer = pbd.UsdWriter(folder / "ours.usdc", model)
    alone = pbd.UsdWriter(folder / "alone.usdc", particles(model))
    points = wp.render.UsdRenderer(str(folder / "points.usdc"))
    lines = wp.render.UsdRenderer(str(folder / "lines.usdc"))
    ms = dict.fromkeys(("simulation", "writing", "merging", "alone", "disk", "points", "points and links"), 0.0)

    def render(renderer: wp.render.UsdRenderer, frame: int, with_lines: bool) -> None:
        x = sim.state.x.numpy()
        renderer.begin_frame(frame / 60.0)
        renderer.render_points("points", x, radius=0.005, as_spheres=False)
        if with_lines:
            renderer.render_line_strip("links", x, color=(0.25, 0.45, 0.75), radius=0.005)
        renderer.end_frame()

    def add(name: str, call, frames: int = FRAMES) -> None:
        ms[name] += 1e3 * timed(call, 1) / frames

    for frame in range(FRAMES):
        add("simulation", sim.step)
        add("writing", lambda: writer.write(sim.state))
        add("alone", lambda: alone.write(sim.state))
        add("points", lambda frame=frame: render(points, frame, False))
        if frame < LINE_FRAMES:
            add("points and links", lambda frame=frame: render(lines, frame, True), LINE_FRAMES)
    add("merging", writer.close)
    add("alone", alone.close)
    add("points", points.save)
    add("points and links", lines.save, LINE_FRAMES)
    add("disk", lambda: plain_files(folder, (folder / "ours.usdc").stat().st_size))
    return {"export": ms["writing"] + ms["merging"], **ms}


def plain_files(folder: Path, size: int) -> None:
    """As many bytes to the disk as an animation of this size."""
    chunks = [folder / f"plain{number}" for number in range(FRAMES // CHUNK)]
    for path in [*chunks, folder / "plain"]:
        with path.open("wb") as file:
            file.write(bytes(size if path.name == "plain" else size // len(chunks)))
            file.flush()
            os.fsync(file.fileno())
    for path in chunks:
        path.unlink()


def peak_memory(frames: int) -> int:
    """KiB of a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        arguments = [sys.executable, __file__, "--write", str(frames), "--folder", folder]
        return int(subprocess.run(arguments, check=True, capture_output=True, text=True).stdout)


def write_and_say_memory(frames: int, folder: Path) -> None:
    model = rope()
    sim = pbd.Simulation(model, method=pbd.Jacobi(1), limits=pbd.Limits(stretch=None))
    with pbd.UsdWriter(folder / "rope.usdc", model) as writer:
        for _ in range(frames):
            sim.step()
            writer.write(sim.state)
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    print(line.split()[1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=9, help="rounds (9)")
    parser.add_argument("--folder", type=Path, help="where to write; on the disk that is to be measured")
    parser.add_argument("--no-memory", action="store_true", help="only the times")
    parser.add_argument("--write", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    if arguments.write:
        write_and_say_memory(arguments.write, arguments.folder)
        return
    model = rope()
    round_of_all(model, arguments.folder)  # compiles
    rounds = [round_of_all(model, arguments.folder) for _ in range(arguments.rounds)]
    print(f"{PARTICLES} particles, {arguments.rounds} rounds of {FRAMES} frames")
    print(f"{'ms a frame':<34} {'min':>7} {'median':>7}   export / this (median)")
    for name, title in {
        "alone": f"export of 10 000 points (at most {LIMIT_MS})",
        "export": "export of 20 000: particles, rope",
        "writing": "  while it runs",
        "merging": "  at the end",
        "disk": "plain files of as many bytes",
        "simulation": "simulation",
        "points": "UsdRenderer, points",
        "points and links": "UsdRenderer, points and links",
    }.items():
        values = [r[name] for r in rounds]
        ratio = statistics.median(r["export"] / r[name] for r in rounds)
        print(f"{title:<34} {min(values):>7.2f} {statistics.median(values):>7.2f}   {ratio:.2f}")
    if not arguments.no_memory:
        peaks = [peak_memory(frames) / 1024 for frames in MEMORY_FRAMES]
        texts = [f"{frames} frames {peak:.0f} MiB" for frames, peak in zip(MEMORY_FRAMES, peaks, strict=True)]
        print(f"peak memory: {', '.join(texts)}, {peaks[1] - peaks[0]:+.0f} (at most {LIMIT_MIB})")


if __name__ == "__main__":
    main()
