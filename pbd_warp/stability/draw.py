"""Draws a map: a panel for each of its settings, a square for each cell, theory as a line over them.

matplotlib is needed here alone in this package.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pbd_warp.accuracy.plot import check_picture
from pbd_warp.atomic import replacing
from pbd_warp.stability.atlas import Cell, Measured
from pbd_warp.stability.classify import OUTCOMES
from pbd_warp.stability.map import Axis, Boundary, Map

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's colours, told apart by colour-blind readers, and a hatching each, which does without colour.
LOOKS: dict[str, tuple[str, str | None]] = {
    "converged": ("#e6f2ec", None),
    "refused": ("#c9c9c9", "--"),
    "off": ("#9fd3f2", "\\\\"),
    "not converged": ("#F0E442", "++"),
    "stretched": ("#E69F00", "."),
    "gained energy": ("#D55E00", "//"),
    "missed": ("#CC79A7", "xx"),
    "not finite": ("#222222", None),
}
LEGEND = {
    "off": "off: > 1 % of the scene from the answer",
    "not converged": "not converged: half of the error is left",
    "stretched": "stretched: a link is > 10 % off its length",
    "gained energy": "gained > 10 % of its energy",
    "missed": "missed: passed through each other",
    "refused": "refused before the run",
}
INK, GREY, LINE = "#222222", "#777777", "#0072B2"
HATCHING = "#00000066"  # lines as faint as the eye needs them: dark ones flicker
MOST_COLUMNS = 3
PANEL_WIDTH, PANEL_HEIGHT = 3.0, 2.3  # inches
LEFT, GAP, BETWEEN, TOP, BELOW = 0.75, 0.3, 0.75, 0.85, 1.25
SMALL = 7.5  # points
MOST_SHADED = 30.0
"""A shaded number from which on a cell is as dark as it gets."""
TICKS = 10
"""Labels on an axis at most."""


def draw(measured: Measured, path: str | Path) -> None:
    """Draw a map as SVG or PNG, by the suffix of `path`; the same cells give the same SVG, byte for byte.

    Raises:
        InputError: another suffix, no such folder, or no matplotlib.
    """
    form = check_picture(path)
    import matplotlib.style
    from matplotlib.figure import Figure

    look: dict[str, Any] = {
        "svg.hashsalt": "pbd-warp",
        "svg.fonttype": "none",
        "font.size": 8.5,
        "axes.edgecolor": GREY,
        "hatch.linewidth": 0.5,
    }
    made = measured.map
    columns = min(MOST_COLUMNS, len(made.panels)) if len(made.panels) != 4 else 2
    rows = math.ceil(len(made.panels) / columns)
    width = max(LEFT + columns * (PANEL_WIDTH + GAP), 7.0)
    height = TOP + rows * PANEL_HEIGHT + (rows - 1) * BETWEEN + BELOW
    with matplotlib.style.context(["default", look]):  # whatever the user's own settings
        figure = Figure(figsize=(width, height))
        for number, name in enumerate(made.panels):
            row, column = divmod(number, columns)
            left = LEFT + column * (PANEL_WIDTH + GAP)
            bottom = height - TOP - (row + 1) * PANEL_HEIGHT - row * BETWEEN
            axes = figure.add_axes((left / width, bottom / height, PANEL_WIDTH / width, PANEL_HEIGHT / height))
            _panel(axes, measured, name)
            if column == 0:
                axes.set_ylabel(made.y.name, size=SMALL + 1.0)
            else:
                axes.tick_params(labelleft=False)
            if number + columns >= len(made.panels):
                axes.set_xlabel(made.x.name, size=SMALL + 1.0)
        figure.text(0.1 / width, 1.0 - 0.3 / height, made.title, size=12, weight="bold", color=INK)
        _legend(figure, made, {cell.outcome for cell in measured.cells})
        note = "; ".join(measured.info[key] for key in ("machine", "versions", "date") if key in measured.info)
        for index, line in enumerate(reversed(textwrap.wrap(note, round(18 * width)))):
            figure.text(0.1 / width, (0.08 + 0.13 * index) / height, line, size=SMALL - 1.5, color=GREY)
        with replacing(Path(path)) as temporary:
            figure.savefig(temporary, format=form, dpi=130, metadata={"Date": None} if form == "svg" else None)


def _panel(axes: Axes, measured: Measured, name: str) -> None:
    """One panel; axes count cells, so that all are of one size whatever the values."""
    made, cells = measured.map, measured.panel(name)
    axes.set(xlim=(-0.5, len(made.x.values) - 0.5), ylim=(-0.5, len(made.y.values) - 0.5))
    axes.set_title(name, size=SMALL + 1.5, color=INK, loc="left", pad=13 if made.panels[name].boundary else 4)
    for outcome in LOOKS:
        _cells(axes, made, [cell for cell in cells.values() if cell.outcome == outcome], outcome, name)
    if made.shade is not None:
        _numbers(axes, made, [cell for cell in cells.values() if cell.outcome == "converged"])
    axes.vlines(np.arange(1, len(made.x.values)) - 0.5, -0.5, len(made.y.values) - 0.5, color="white", linewidth=0.6)
    axes.hlines(np.arange(1, len(made.y.values)) - 0.5, -0.5, len(made.x.values) - 0.5, color="white", linewidth=0.6)
    boundary = made.panels[name].boundary
    if boundary is not None:
        line = boundary_line(made, boundary)
        axes.plot(*line.T, color="white", linewidth=3.2, solid_capstyle="butt", zorder=4)
        axes.plot(*line.T, color=LINE, linewidth=1.6, zorder=5, gid=f"theory-{name}".replace(" ", "-"))
        axes.text(0.0, 1.02, boundary.formula, transform=axes.transAxes, size=SMALL, color=LINE, va="bottom")
    _ticks(axes.xaxis, made.x)
    _ticks(axes.yaxis, made.y)
    axes.tick_params(length=2, labelsize=SMALL, colors=INK)


def _cells(axes: Axes, made: Map, cells: Iterable[Cell], outcome: str, panel: str) -> None:
    """All cells of one outcome, as one path; those above each other as one piece, which keeps the SVG small."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    corners: list[tuple[float, float]] = []
    for i, j, above in _runs((made.x.values.index(cell.x), made.y.values.index(cell.y)) for cell in cells):
        left, right, bottom, top = i - 0.5, i + 0.5, j - 0.5, above + 0.5
        corners += [(left, bottom), (right, bottom), (right, top), (left, top), (left, bottom)]
    if not corners:
        return
    colour, hatch = LOOKS[outcome]
    codes = [Outline.MOVETO, Outline.LINETO, Outline.LINETO, Outline.LINETO, Outline.CLOSEPOLY]
    outline = Outline(corners, codes * (len(corners) // len(codes)))
    name = f"{outcome}-{panel}".replace(" ", "-")
    axes.add_patch(PathPatch(outline, facecolor=colour, edgecolor=HATCHING, linewidth=0.0, hatch=hatch, gid=name))


def _numbers(axes: Axes, made: Map, cells: Iterable[Cell]) -> None:
    """Shade cells by a number of theirs, darker for more, and write it into them."""
    assert made.shade is not None
    for cell in cells:
        value = getattr(cell, made.shade)
        dark = min(math.log(max(value, 1.0)) / math.log(MOST_SHADED), 1.0)
        i, j = made.x.values.index(cell.x), made.y.values.index(cell.y)
        corners = ([i - 0.5, i + 0.5, i + 0.5, i - 0.5], [j - 0.5, j - 0.5, j + 0.5, j + 0.5])
        axes.fill(*corners, color=LINE, alpha=0.08 + 0.6 * dark, linewidth=0.0, zorder=2)
        axes.text(
            i, j, f"{value:.1f}" if value < 10.0 else f"{value:.0f}", size=SMALL, ha="center", va="center", zorder=3
        )


def _runs(places: Iterable[tuple[int, int]]) -> list[tuple[int, int, int]]:
    """Cells (i, j) as columns (i, lowest j, highest j) without gaps."""
    runs: list[tuple[int, int, int]] = []
    for i, j in sorted(places):
        if runs and runs[-1][0] == i and runs[-1][2] == j - 1:
            runs[-1] = (i, runs[-1][1], j)
        else:
            runs.append((i, j, j))
    return runs


def boundary_line(made: Map, boundary: Boundary) -> np.ndarray:
    """The boundary as places on the axes, in cells, shape [n, 2]; where it leaves the map it runs along the edge."""
    along, across = (made.x, made.y) if boundary.along == "x" else (made.y, made.x)
    last = len(along.values) - 1
    places = np.linspace(0.0, last, 4 * last + 1)
    at = np.array([across.place(boundary.of(along.value(place))) for place in places])
    at = np.clip(at, -0.5, len(across.values) - 0.5)
    # To the edges of the outer cells, which the line's last points stand for.
    places, at = np.r_[-0.5, places, last + 0.5], np.r_[at[0], at, at[-1]]
    line: np.ndarray = np.stack([places, at], axis=1)
    return line if boundary.along == "x" else line[:, ::-1]


def _ticks(axis: Any, values: Axis) -> None:
    """As many of the cells' values as there is room for."""
    step = math.ceil(len(values.values) / TICKS)
    shown = range(0, len(values.values), step)
    axis.set_ticks(list(shown), labels=[_text(values.values[k]) for k in shown])


def _text(value: float) -> str:
    """Short: 1e4 for 10000."""
    return f"{value:g}" if 1e-3 <= value < 1e4 else f"{value:.0e}".replace("e+0", "e").replace("e-0", "e-")


def _legend(figure: Any, made: Map, outcomes: set[str]) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Patch(facecolor=colour, edgecolor=HATCHING, linewidth=0.0, hatch=hatch, label=LEGEND.get(outcome, outcome))
        for outcome, (colour, hatch) in LOOKS.items()
        if outcome in outcomes
    ]
    if any(panel.boundary for panel in made.panels.values()):
        handles.append(Line2D([], [], color=LINE, linewidth=1.6, label="theory: runs begin to fail"))
    figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.3 / figure.get_figheight()), ncols=3, frameon=False,
        fontsize=SMALL, columnspacing=1.2, handletextpad=0.5, handleheight=1.1, borderaxespad=0.0, borderpad=0.5,
    )  # fmt: skip


assert LOOKS.keys() == OUTCOMES.keys()
