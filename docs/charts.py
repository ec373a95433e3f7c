"""Makes the charts anew (docs/charts/SCENE.svg, the numbers in pbd_warp/accuracy/charts), then docs/methods.md's table.

    pip install '.[chart]' && python docs/charts.py            # everything, some 15 minutes
    python docs/charts.py rope chain                           # these scenes, then the table
    python docs/charts.py none                                 # the table alone

Each chart is `pbd-warp chart SCENE` at its defaults. On a quiet machine: what else runs is in the figures.
"""

import subprocess
import sys
from pathlib import Path

import pbd_warp as pbd
from pbd_warp.accuracy.chart import flags, load, pick
from pbd_warp.accuracy.sweep import charts_folder

HERE = Path(__file__).parent
PICTURES = HERE / "charts"
NUMBERS = charts_folder()
ERRORS = (1e-1, 1e-2, 1e-3, 1e-5)  # m
BEGIN, END = "<!-- table: python docs/charts.py -->\n", "<!-- end of table -->\n"


def measure(scene: str) -> None:
    command = "from pbd_warp.cli import main; main()"
    files = ["--out", str(PICTURES / f"{scene}.svg"), "--csv", str(NUMBERS / f"{scene}.csv")]
    subprocess.run([sys.executable, "-c", command, "chart", scene, *files], check=True)


def charted() -> list[str]:
    """The scenes that have a chart; those of the atlas alone (docs/stability) have none."""
    return [scene for scene in pbd.scene_names() if (NUMBERS / f"{scene}.csv").is_file()]


def table() -> str:
    lines = ["| scene | within | cheapest settings | ms per simulated second |", "|---|---|---|---|"]
    for scene in charted():
        rows = load(NUMBERS / f"{scene}.csv").rows
        for error in ERRORS:
            row = pick(rows, error)
            what = f"`{flags(row)}` | {row.wall_ms_per_sim_second:.2g}" if row else "none measured | "
            lines.append(f"| {scene} | {error:g} m | {what} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    for scene in sys.argv[1:] or charted():
        if scene != "none":
            measure(scene)
    page = HERE / "methods.md"
    before, rest = page.read_text().split(BEGIN)
    page.write_text(before + BEGIN + table() + END + rest.split(END)[1])


if __name__ == "__main__":
    main()
