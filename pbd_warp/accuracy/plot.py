"""Draws a chart of speed against accuracy; matplotlib is needed here alone."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pbd_warp.accuracy.chart import LABEL, Chart, Row, failed, front
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
from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError
from pbd_warp.paths import check_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

# The picture: sizes in inches.

WIDTH, PANEL_WIDTH, PANEL_HEIGHT = 11.0, 4.85, 4.6
LEFT, GAP, TOP = 0.75, 0.25, 0.5
LINE = 0.17  # from one line of small type to the next

# Okabe and Ito's colours, told apart by colour-blind readers; a method or integrator not listed gets a spare one.
COLOURS = {"jacobi": "#0072B2", "gauss-seidel": "#009E73", "chebyshev": "#CC79A7", "direct": "#D55E00"}
SPARE_COLOURS = ("#E69F00", "#56B4E9", "#000000")
SHAPES = {"pbd": "o", "bdf2": "s", "midpoint": "^", "midpoint4": "D"}
SPARE_SHAPES = ("v", "P", "p", "<", ">")
FAINT = 0.35  # opacity of what did not converge

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


def draw(chart: Chart, path: str | Path) -> None:
    """Draw the chart as SVG or PNG, by the suffix of `path`; the same chart gives the same SVG, byte for byte.

    A group of the SVG holds the rows that look alike and is named after them: `wall-diverged-direct-midpoint-float64`.
    """
    form = check_picture(path)
    import matplotlib.style
    from matplotlib.figure import Figure

    look: dict[str, Any] = {
        "svg.hashsalt": "pbd-warp",
        "svg.fonttype": "none",
        "font.size": 9.0,
        "axes.edgecolor": GREY,
    }
    with matplotlib.style.context(["default", look]):  # whatever the user's own settings
        notes = _notes(chart.info)
        keys = _keys(chart.rows)
        below = 0.72 + LINE * (1.0 + math.ceil(max(len(handles) for _, handles in keys) / 2) + len(notes))
        height = TOP + PANEL_HEIGHT + below
        figure = Figure(figsize=(WIDTH, height))
        errors = Scale.of(row.position_error for row in chart.rows if not failed(row))
        for index, panel in enumerate(PANELS):
            left = LEFT + index * (PANEL_WIDTH + GAP)
            axes = figure.add_axes((left / WIDTH, below / height, PANEL_WIDTH / WIDTH, PANEL_HEIGHT / height))
            _panel(axes, chart.rows, panel, errors)
            axes.tick_params(labelleft=index == 0)
        figure.axes[0].set_ylabel("position error [m]")
        title = ", ".join(dict.fromkeys(row.scene for row in chart.rows))
        figure.text(LEFT / WIDTH, 1.0 - 0.3 / height, title, size=13, weight="bold", color=INK)
        _write_below(figure, keys, notes, below / height)
        with replacing(Path(path)) as temporary:
            figure.savefig(temporary, format=form, dpi=150, metadata={"Date": None} if form == "svg" else None)


def _panel(axes: Axes, rows: Sequence[Row], panel: str, errors: Scale) -> None:
    """One panel: every row, the front, the guides, the float32 floor, and what the strips at the edges hold."""
    cost, label = PANELS[panel]
    costs = Scale.of(getattr(row, cost) for row in rows)
    axes.set(xscale="log", yscale="log", xlim=costs.limits, ylim=errors.limits, xlabel=label)
    axes.grid(color=PALE, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)

    def place(row: Row) -> Place:
        return costs.place(getattr(row, cost)), errors.place(math.inf if failed(row) else row.position_error)

    colours, shapes = _colours(rows), _shapes(rows)
    groups: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault((_kind(row), row.method, row.integrator, row.dtype), []).append(row)
    for (kind, method, integrator, dtype), group in groups.items():
        look = _look(kind, colours[method], shapes[integrator], dtype)
        name = "-".join((panel, kind, method, integrator, dtype)).replace(" ", "-")
        _plot(axes, [place(row) for row in group], name, **look)
        if panel == "wall" and kind != "diverged":
            _spreads(axes, group, costs, errors, look)

    best = front(rows, cost)
    line = [place(row) for row in best]
    taken = [*map(place, rows), *along(line)]
    if line:
        _plot(axes, line, f"{panel}-front", color=INK, linewidth=1.1, zorder=2)
        taken += _name_front(axes, best, line)
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


def _kind(row: Row) -> str:
    return "diverged" if failed(row) else row.outcome


def _colours(rows: Iterable[Row]) -> dict[str, str]:
    return _assign(COLOURS, SPARE_COLOURS, {row.method for row in rows})


def _shapes(rows: Iterable[Row]) -> dict[str, str]:
    return _assign(SHAPES, SPARE_SHAPES, {row.integrator for row in rows})


def _assign(known: dict[str, str], spare: Sequence[str], names: set[str]) -> dict[str, str]:
    """A colour or shape for each name, known names first, so that a name looks alike in every chart."""
    others = sorted(names - known.keys())
    signs = {name: sign for name, sign in known.items() if name in names}
    return signs | {name: spare[index % len(spare)] for index, name in enumerate(others)}


def _look(kind: str, colour: str, shape: str, dtype: str) -> dict[str, Any]:
    """How rows are drawn. Hollow is larger than filled: of two in one place both are seen."""
    if kind == "diverged":
        return {
            "marker": "x",
            "color": colour,
            "linestyle": "none",
            "markersize": 5.5,
            "markeredgewidth": 1.1,
            "zorder": 3,
        }
    hollow = dtype == "float32"
    return {
        "marker": shape,
        "color": colour,
        "linestyle": "none",
        "markerfacecolor": "none" if hollow else colour,
        "markersize": 7.5 if hollow else 4.5,
        "markeredgewidth": 0.9 if hollow else 0.0,
        "alpha": FAINT if kind == "not converged" else 1.0,
        "zorder": 3 if kind == "not converged" else 4,
    }


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


def _name_front(axes: Axes, best: Sequence[Row], line: Sequence[Place]) -> list[Place]:
    """Write the labels below and left of rows of the front, where no row can be; leave out what collides."""
    named: list[Place] = []
    paper = {"facecolor": "white", "linewidth": 0.0, "pad": 0.3}  # hides the float32 floor behind the text
    for row, (x, y) in zip(best, line, strict=True):
        if all(abs(x - other_x) > 0.08 or abs(y - other_y) > 0.035 for other_x, other_y in named):
            write(axes, x - 0.012, y - 0.007, row.label, ha="right", va="top", zorder=1.8, bbox=paper)
            named.append((x, y))
    return [(x - 0.04, y - 0.025) for x, y in named]


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


def _keys(rows: Sequence[Row]) -> list[tuple[str, list[Line2D]]]:
    """What the colours, shapes and marks in use mean: titles, each with its handles."""
    from matplotlib.lines import Line2D

    def key(label: str, **look: Any) -> Line2D:
        base: dict[str, Any] = {"linestyle": "none", "color": GREY, "markersize": 5.5, "markeredgewidth": 0.0}
        return Line2D([], [], label=label, **(base | look))

    dtypes, kinds = {row.dtype for row in rows}, set(map(_kind, rows))
    marks = [
        ("float32" in dtypes, key("float32", **_look("converged", GREY, "o", "float32"))),
        (dtypes != {"float32"}, key("float64", marker="o")),
        ("not converged" in kinds, key("not converged", marker="o", alpha=FAINT)),
        ("diverged" in kinds, key("diverged, at the top edge", **_look("diverged", GREY, "", ""))),
        (
            kinds != {"diverged"},
            key(f"Pareto front, as {LABEL}", linestyle="-", color=INK),
        ),
        (any(row.wall_spread > 0.0 for row in rows), key("spread of the repetitions", linestyle="-", linewidth=0.9)),
    ]
    return [
        ("Method", [key(name, marker="o", color=colour) for name, colour in _colours(rows).items()]),
        ("Integrator", [key(name, marker=shape) for name, shape in _shapes(rows).items()]),
        ("Mark", [handle for shown, handle in marks if shown]),
    ]


def _notes(info: dict[str, str]) -> list[str]:
    """The small type under the picture, in lines that fit its width."""
    made = "; ".join(info[name] for name in ("machine", "versions", "date") if info.get(name))
    reference = f"Error against: {info['reference']}" if info.get("reference") else ""
    return [line for text in (reference, made) for line in textwrap.wrap(text, 180)]


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
