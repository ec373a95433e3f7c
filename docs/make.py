"""Makes all that is measured or drawn in the docs anew, in one go, and says how long each part took.

    pip install '.[test,peers]' && python docs/make.py        # everything, on a quiet machine
    python docs/make.py charts methods                        # these parts, in this order

Parts: `peers` (benchmarks/peers.py, into pbd_warp/accuracy/peers.csv), `charts` (docs/charts.py, with the tables of
methods.md), `methods` (those tables alone), `atlas` (docs/stability), `gallery`, `pictures`, `stages` and `colliders`
(Chromium for the view's). stage_blender.py, which needs Blender, is not among them. What is timed comes first, one at a
time on one core; what else runs meanwhile is in its figures.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parent.parent
COMMAND = [sys.executable, "-c", "from pbd_warp.cli import main; main()"]


def script(path: str, *arguments: str) -> list[str]:
    return [sys.executable, str(ROOT / path), *arguments]


PARTS = {
    "peers": script("benchmarks/peers.py", "--out", str(ROOT / "pbd_warp/accuracy/peers.csv")),
    "charts": script("docs/charts.py"),
    "methods": script("docs/charts.py", "none"),
    "atlas": [*COMMAND, "stability", "--out", str(ROOT / "docs/stability")],
    "gallery": script("docs/gallery.py"),
    "pictures": script("docs/pictures.py"),
    "stages": script("docs/stage_picture.py"),
    "colliders": script("docs/colliders.py"),
}


def main() -> None:
    chosen = sys.argv[1:] or [part for part in PARTS if part != "methods"]
    if unknown := set(chosen) - set(PARTS):
        sys.exit(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    failed = []
    for part in chosen:
        start = time.perf_counter()
        done = subprocess.run(PARTS[part], cwd=ROOT, env={**os.environ, "OMP_NUM_THREADS": "1"}, check=False)
        print(f"{part}: {time.perf_counter() - start:.0f} s, exit code {done.returncode}", flush=True)
        failed += [part] * (done.returncode != 0)
    if failed:
        sys.exit(f"failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
