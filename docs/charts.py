"""Makes the charts anew (docs/charts/SCENE.svg, the numbers in pbd_warp/accuracy/charts) and the tables of methods.md.

    pip install '.[chart]' && python docs/charts.py            # everything
    python docs/charts.py rope chain                           # these scenes, then the tables
    python docs/charts.py none                                 # the tables alone
    python docs/charts.py redraw                               # all from the numbers that there are

Each chart is `pbd-warp chart SCENE` at its defaults, with the other simulators of pbd_warp/accuracy/peers.csv as grey
lines (benchmarks/peers.py measures them). On a quiet machine: what else runs is in the figures.
"""

import re
import subprocess
import sys
from pathlib import Path

import pbd_warp as pbd
from pbd_warp.accuracy import peers
from pbd_warp.accuracy.chart import NO_METHOD, Row, flags, load, pick
from pbd_warp.accuracy.sweep import charts_folder
from pbd_warp.step.methods import METHODS

HERE = Path(__file__).parent
PICTURES = HERE / "charts"
NUMBERS = charts_folder()
PEERS = NUMBERS.parent / "peers.csv"
ERRORS = (1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-9)  # m


def measure(scene: str, redraw: bool) -> None:
    command = "from pbd_warp.cli import main; main()"
    numbers = str(NUMBERS / f"{scene}.csv")
    files = [
        "--out",
        str(PICTURES / f"{scene}.svg"),
        *(["--from-csv", numbers] if redraw else [scene, "--csv", numbers]),
    ]
    others = ["--peers", str(PEERS)] if PEERS.is_file() else []
    subprocess.run([sys.executable, "-c", command, "chart", *files, *others], check=True)


def charted() -> list[str]:
    """The scenes that have a chart; those of the atlas alone (docs/stability) have none."""
    return [scene for scene in pbd.scene_names() if (NUMBERS / f"{scene}.csv").is_file()]


def cheapest() -> list[list[str]]:
    """The fastest settings within each error, and what the best of each method takes over that."""
    kinds = [*METHODS, NO_METHOD]
    table = [["scene", "within", "fastest settings", "ms", *METHODS, "no method"]]
    for scene in charted():
        rows = load(NUMBERS / f"{scene}.csv").rows
        for error in ERRORS:
            best = pick(rows, error)
            if best is None:
                table.append([scene, f"{error:g} m", "none measured", *[""] * (1 + len(kinds))])
                break
            others = [over(pick([row for row in rows if row.method == kind], error), best) for kind in kinds]
            time = f"{best.wall_ms_per_sim_second:.2g}"
            table.append([scene, f"{error:g} m", f"`{flags(best)}`", time, *others])
    return table


def over(row: Row | None, best: Row) -> str:
    return ratio(row.wall_ms_per_sim_second, best.wall_ms_per_sim_second) if row else "-"


def ratio(time: float, best: float) -> str:
    return f"{time / best:.2g}" if time < 10.0 * best else f"{time / best:.0f}"


def compared() -> list[list[str]]:
    """What others take, over what we do."""
    names = {name: title for name, title in peers.NAMES.items() if name != peers.OURS}
    table = [["scene", "within", "ours, ms", "by", *names.values()]]
    rows = peers.load(PEERS)[0]
    for scene in dict.fromkeys(row.scene for row in rows):
        for error in ERRORS:
            within = {
                name: next((r for r in peers.front(rows, scene, name) if r.position_error <= error), None)
                for name in (peers.OURS, *names)
            }
            ours = within.pop(peers.OURS)
            if ours is None:
                break
            own = ours.wall_ms_per_sim_second
            times = [ratio(r.wall_ms_per_sim_second, own) if r else "-" for r in within.values()]
            by = f"{ours.settings}, " + (f"1e-{ours.steps} m/s" if "auto" in ours.settings else f"{ours.steps} a frame")
            table.append([scene, f"{error:g} m", f"{ours.wall_ms_per_sim_second:.2g}", by, *times])
    return table


def unable() -> list[list[str]]:
    """Peers that could not be measured at all."""
    rows = peers.load(PEERS)[0]
    said = {(peers.NAMES[row.peer], row.outcome.split(": ", 1)[-1]) for row in rows if row.steps == 0}
    return [["simulator", "why it has no row"], *map(list, sorted(said))]


TABLES = {"cheapest": cheapest} | ({"peers": compared, "unable": unable} if PEERS.is_file() else {})


def markdown(table: list[list[str]]) -> str:
    lines = ["| " + " | ".join(cells) + " |" for cells in table]
    return "\n".join([lines[0], "|" + "---|" * len(table[0]), *lines[1:]]) + "\n"


def main() -> None:
    wanted = sys.argv[1:]
    redraw = wanted == ["redraw"]
    for scene in charted() if redraw or not wanted else wanted:
        if scene != "none":
            measure(scene, redraw)
    page = HERE / "methods.md"
    text = page.read_text()
    for name, make in TABLES.items():
        pattern = rf"(<!-- table: {name} -->\n).*?(<!-- end of table -->)"
        made = markdown(make())
        text, found = re.subn(pattern, lambda match, made=made: match[1] + made + match[2], text, flags=re.DOTALL)
        if found != 1:
            sys.exit(f"{page} must have one place for the table {name}")
    page.write_text(text)


if __name__ == "__main__":
    main()
