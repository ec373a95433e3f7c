"""The page that shows all maps: Markdown, as docs are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pbd_warp.stability.atlas import Measured
from pbd_warp.stability.classify import OUTCOMES


def page(atlas: Sequence[Measured]) -> str:
    """The page of some maps whose pictures and numbers lie beside it as NAME.svg and NAME.csv."""
    cells = sum(len(measured.cells) for measured in atlas)
    lines = [
        "# Where methods fail",
        "",
        f"The atlas of stability, made by `pbd-warp stability`: {len(atlas)} maps, {cells} runs. Two parameters of a "
        "scene are swept against each other, in a panel for each of some settings. A cell is one run, judged by its "
        "figures; no cell is left out. Where theory says at which value runs begin to fail, that is the blue line, "
        "with its formula below; pbd_warp/stability/theory.py derives them.",
        "",
        "What a cell is, the first of these that is so:",
        "",
        "| outcome | when |",
        "|---|---|",
        *(f"| {outcome} | {threshold} |" for outcome, threshold in OUTCOMES.items()),
        "",
        "| map | parameters | what helps |",
        "|---|---|---|",
        *(
            f"| [{m.map.name}](#{m.map.name}) | {m.map.x.name} \N{MULTIPLICATION SIGN} {m.map.y.name} "
            f"| {m.map.remedy} |"
            for m in atlas
        ),
    ]
    for measured in atlas:
        lines += ["", *_section(measured)]
    return "\n".join(lines) + "\n"


def _section(measured: Measured) -> list[str]:
    made = measured.map
    lines = [f"## {made.name}", "", made.text, "", f"What helps: {made.remedy}.", ""]
    lines += [f"![{made.title}]({made.name}.svg)", "", _counts(measured)]
    return lines


def _counts(measured: Measured) -> str:
    """How many cells of each outcome, and whether they are where theory has them."""
    made = measured.map
    counts = Counter(cell.outcome for cell in measured.cells)
    text = ", ".join(f"{counts[outcome]} {outcome}" for outcome in OUTCOMES if counts[outcome])
    text = f"Scene `{made.scene}`, [numbers]({made.name}.csv): {text}."
    known = [name for name, panel in made.panels.items() if panel.boundary]
    if known:
        off = sum(len(measured.beside_theory(name)) for name in known)
        where = "No cell" if off == 0 else f"{off} cell{'s' * (off > 1)}"
        text += f" {where} on the wrong side of theory by more than one cell."
    return text
