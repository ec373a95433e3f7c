"""Draws a chart of speed against accuracy; matplotlib is needed here alone."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pbd_warp.accuracy.chart import Chart, Row, failed, front
from pbd_warp.accuracy.labels import (
    GREY,
    INK,
    PALE,
    SMALL,
    Place,
    Scale,
    along,
    emptiest,
    shade_strip,
    write,
    write_beside,
)
from pbd_warp.accuracy.marks import colours, keys, kind, look, shapes
from pbd_warp.accuracy.peers import NAMES, PeerRow, fronts
from pbd_warp.accuracy.title import seen, seen_of_peers
from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError
from pbd_warp.paths import check_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# The picture: sizes in inches.

WIDTH, PANEL_WIDTH, PANEL_HEIGHT = 11.0, 4.85, 4.6
LEFT, GAP, TOP = 0.75, 0.25, 0.85
LINE = 0.17  # from one line of small type to the next

PANELS = {
    "wall": ("wall_ms_per_sim_second", "wall time for one simulated second [ms]"),
    "projections": ("projections_per_sim_second", "constraint projections for one simulated second, on any hardware"),
}


def check_picture(path: str | Path) -> str:
    """ "svg" or "png", or an InputError that says why no chart can be drawn there."""
    form = Path(path).suffix.lower().removeprefix(".")
    if form not in ("svg", "png"):
        raise InputError(f"a chart is drawn as .svg or .png, not {str(path)!r}")
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        raise InputError("drawing a chart needs matplotlib: pip install 'pbd-warp[chart]'") from None
    check_file(Path(path))
    return form


def draw(chart: Chart, path: str | Path, peers: Sequence[PeerRow] = ()) -> None:
    """Draw the chart as SVG or PNG, by the suffix of `path`; the same chart gives the same SVG, byte for byte.

    A group of the SVG holds the rows that look alike and is named after them: `wall-diverged-direct-midpoint-float64`;
    with `-rest` at its end those that are on no method's own front.

    Args:
        peers: Rows of other simulators on the same scene, drawn as grey lines.
    """
    form = check_picture(path)
    import matplotlib.style
    from matplotlib.figure import Figure

    style: dict[str, Any] = {
        "svg.hashsalt": "pbd-warp",
        "svg.fonttype": "none",
        "font.size": 9.0,
        "axes.edgecolor": GREY,
    }
    with matplotlib.style.context(["default", style]):  # whatever the user's own settings
        notes = _notes(chart.info, peers)
        legends = keys(chart.rows, bool(peers))
        below = 0.72 + LINE * (1.0 + math.ceil(max(len(handles) for _, handles in legends) / 2) + len(notes))
        height = TOP + PANEL_HEIGHT + below
        figure = Figure(figsize=(WIDTH, height))
        others = fronts(peers)
        reached = [row.position_error for row in chart.rows if not failed(row)]
        errors = Scale.of([*reached, *(row.position_error for line in others.values() for row in line)])
        for index, panel in enumerate(PANELS):
            left = LEFT + index * (PANEL_WIDTH + GAP)
            axes = figure.add_axes((left / WIDTH, below / height, PANEL_WIDTH / WIDTH, PANEL_HEIGHT / height))
            _panel(axes, chart.rows, panel, errors, others if panel == "wall" else {})
            axes.tick_params(labelleft=index == 0)
        figure.axes[0].set_ylabel("position error [m]")
        title = f"{', '.join(dict.fromkeys(row.scene for row in chart.rows))}: {seen(chart.rows)}"
        for index, text in enumerate([*textwrap.wrap(title, 124)[:2], seen_of_peers(peers)]):
            figure.text(LEFT / WIDTH, 1.0 - (0.25 + 0.22 * index) / height, text, size=10, weight="bold", color=INK)
        _write_below(figure, legends, notes, below / height)
        with replacing(Path(path)) as temporary:
            figure.savefig(temporary, format=form, dpi=150, metadata={"Date": None} if form == "svg" else None)


def _panel(axes: Axes, rows: Sequence[Row], panel: str, errors: Scale, peers: Mapping[str, Sequence[PeerRow]]) -> None:
    """One panel: every row, strong on its method's own front and faint elsewhere, the front of all, other simulators,
    the guides, the float32 floor, and what the strips at the edges hold."""
    cost, label = PANELS[panel]
    others = [row.wall_ms_per_sim_second for line in peers.values() for row in line]
    costs = Scale.of([*(getattr(row, cost) for row in rows), *others])
    axes.set(xscale="log", yscale="log", xlim=costs.limits, ylim=errors.limits, xlabel=label)
    axes.grid(color=PALE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)

    def place(row: Row) -> Place:
        return costs.place(getattr(row, cost)), errors.place(math.inf if failed(row) else row.position_error)

    colour, shape = colours(rows), shapes(rows)
    own_fronts = {method: front((row for row in rows if row.method == method), cost) for method in colour}
    own = {id(row) for line in own_fronts.values() for row in line}
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        rest = "" if failed(row) or id(row) in own else "rest"
        groups.setdefault((kind(row), row.method, row.integrator, row.dtype, rest), []).append(row)
    for (outcome, method, integrator, dtype, rest), group in groups.items():
        looks = look(outcome, colour[method], shape[integrator], dtype, not rest)
        name = "-".join(filter(None, (panel, outcome, method, integrator, dtype, rest))).replace(" ", "-")
        _plot(axes, [place(row) for row in group], name, **looks)
        if panel == "wall" and outcome != "diverged" and not rest:
            _spreads(axes, group, costs, errors, looks)
    for method, line in own_fronts.items():
        places = [place(row) for row in line]
        _plot(axes, places, f"{panel}-own-front-{method}", color=colour[method], linewidth=0.7, zorder=2.2)

    best = front(rows, cost)
    places = [place(row) for row in best]
    taken = [*(place(row) for row in rows if id(row) in own), *along(places)]
    for name, theirs in peers.items():
        at = [(costs.place(row.wall_ms_per_sim_second), errors.place(row.position_error)) for row in theirs]
        taken += _peer(axes, NAMES[name], at)
    if places:
        _plot(axes, places, f"{panel}-front", color=INK, linewidth=1.1, zorder=2)
        taken += _name_front(axes, best, places)
        taken += _guides(axes, costs, errors, taken, panel)
    reached = [row.position_error for row in rows if row.dtype == "float32" and not failed(row)]
    if reached:
        y = errors.place(min(reached))
        _plot(axes, [(0.0, y), (1.0, y)], f"{panel}-floor", color=GREY, linewidth=0.9, linestyle=":", zorder=1.5)
        write_beside(axes, f"float32 floor {min(reached):.2g} m", y + 0.022, 0.27, taken)
    if any(map(failed, rows)):
        shade_strip(axes, 1.0 - Scale.STRIP, "diverged", taken)
    if any(row.position_error <= 0.0 and not failed(row) for row in rows):
        shade_strip(axes, 0.0, "no error", taken)


def _plot(axes: Axes, places: Sequence[Place], name: str, **look: Any) -> None:
    """Draw a line or markers at places; unclipped, as all lie inside the panel and a clip for each swells the SVG."""
    xs, ys = [x for x, _ in places], [y for _, y in places]
    axes.plot(xs, ys, transform=axes.transAxes, clip_on=False, gid=name, **look)


def _spreads(axes: Axes, rows: Iterable[Row], costs: Scale, errors: Scale, look: dict[str, Any]) -> None:
    """Bars as long as the spread of the repetitions, centred: which side of the median was longer is not kept."""
    xs: list[float] = []
    ys: list[float] = []
    for row in rows:
        if 0.0 < row.wall_spread < math.inf:
            ends = [row.wall_ms_per_sim_second * (1.0 + side * row.wall_spread / 2.0) for side in (-1.0, 1.0)]
            xs += [min(max(costs.place(end), 0.0), 1.0) for end in ends] + [math.nan]  # nan lifts the pen
            ys += [errors.place(row.position_error)] * 3
    if xs:
        bars = list(zip(xs, ys, strict=True))
        _plot(axes, bars, "", color=look["color"], alpha=0.6 * look["alpha"], linewidth=0.9, zorder=2.5)


def _peer(axes: Axes, name: str, line: list[Place]) -> list[Place]:
    """Another simulator's front, with its name at the accurate end."""
    _plot(axes, line, f"wall-peer-{name}", color=GREY, linewidth=2.0, alpha=0.6, zorder=2.0)
    x, y = line[-1]
    write(axes, x, y - 0.012, name, ha="center", va="top", color=GREY, weight="bold")
    return [*along(line), (x, y - 0.02)]


def _name_front(axes: Axes, best: Sequence[Row], line: Sequence[Place]) -> list[Place]:
    """Write beside the rows of the front what they are, where no row can be: below and left of them. Where method or
    integrator change their names too. What collides is left out, names last."""
    paper = {
        "facecolor": "white",
        "linewidth": 0.0,
        "pad": 0.3,
        "alpha": 0.8,
    }  # hides the float32 floor behind the text
    turns = [k for k in range(len(best)) if k == 0 or best[k].name != best[k - 1].name]
    named: list[tuple[float, float, float]] = []  # right end, height, width
    for k in [*turns, *(k for k in range(len(best)) if k not in turns)]:
        text = f"{best[k].name} {best[k].label}" if k in turns else best[k].label
        x, y, width = line[k][0], line[k][1], 0.0105 * len(text)
        outside = x - width < 0.0
        if outside and k == 0:  # no room on the left
            write(axes, x + 0.012, y + 0.012, text, ha="left", va="bottom", zorder=1.8, bbox=paper)
        elif not outside and all(
            x < left_of - other_width or x - width > left_of or abs(y - other_y) > 0.03
            for left_of, other_y, other_width in named
        ):
            write(axes, x - 0.012, y - 0.007, text, ha="right", va="top", zorder=1.8, bbox=paper)
            named.append((x, y, width))
    return [(x - width * part, y - 0.02) for x, y, width in named for part in (0.25, 0.5, 0.75, 1.0)]


def _guides(axes: Axes, costs: Scale, errors: Scale, taken: Sequence[Place], panel: str) -> list[Place]:
    """A fan of error ~ cost^-1, cost^-2, cost^-4, all of one length, where it hides least."""
    box = (0.27, 0.25)
    centres = [(0.16 + 0.04 * i, 0.2 + 0.04 * j) for j in range(15) for i in range(18)]
    x, y = emptiest(centres, box, taken)
    x, y = x - box[0] / 2.0 + 0.01, y + box[1] / 2.0
    across, used = PANEL_WIDTH / (costs.high - costs.low), [(x, y)]
    for slope in (1, 2, 4):
        down = slope * PANEL_HEIGHT / (errors.high - errors.low)
        length = 0.85 / math.hypot(across, down)
        dx, dy = across * length / PANEL_WIDTH, down * length / PANEL_HEIGHT
        look: dict[str, Any] = {"color": GREY, "linewidth": 0.8, "linestyle": (0, (4, 3)), "zorder": 1.5}
        _plot(axes, [(x, y), (x + dx, y - dy)], f"{panel}-slope-{slope}", **look)
        text = "slope " * (slope == 1) + f"\N{MINUS SIGN}{slope}"
        write(axes, x + 1.06 * dx, y - 1.06 * dy, text, ha="left", va="center" if across > down else "top")
        used += along([(x, y), (x + 1.2 * dx, y - 1.2 * dy)])
    return used


def _notes(info: dict[str, str], peers: Sequence[PeerRow]) -> list[str]:
    """The small type under the picture, in lines that fit its width."""
    made = "; ".join(info[name] for name in ("machine", "versions", "date") if info.get(name))
    reference = f"Error against: {info['reference']}" if info.get("reference") else ""
    unable = "; ".join(f"{NAMES[row.peer]}: {row.outcome.split(': ', 1)[-1]}" for row in peers if row.steps == 0)
    return [line for text in (reference, made, unable) for line in textwrap.wrap(text, 180)]


def _write_below(figure: Figure, keys: list[tuple[str, list[Line2D]]], notes: list[str], below: float) -> None:
    """The legends and the notes under the panels, whose lower edge is at `below`, a fraction of the height."""
    height = figure.get_figheight()
    for (title, handles), left in zip(keys, (0.0, 2.7, 5.1), strict=True):
        figure.legend(
            handles=handles,
            title=title,
            loc="upper left",
            bbox_to_anchor=((LEFT + left) / WIDTH, below - 0.55 / height),
            ncols=2,
            fontsize=SMALL + 1.0,
            title_fontproperties={"weight": "bold", "size": SMALL + 1.0},
            alignment="left",
            frameon=False,
            borderpad=0.0,
            borderaxespad=0.0,
            labelspacing=0.35,
            columnspacing=1.2,
        )
    for index, line in enumerate(reversed(notes)):
        figure.text(LEFT / WIDTH, (0.12 + LINE * index) / height, line, size=SMALL, color=INK)
