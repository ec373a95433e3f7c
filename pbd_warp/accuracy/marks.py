"""How rows of a chart look: colours are methods, shapes integrators; and the keys that say so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from pbd_warp.accuracy.chart import LABEL, NO_METHOD, Row, failed
from pbd_warp.accuracy.labels import GREY, INK

if TYPE_CHECKING:
    from matplotlib.lines import Line2D

# Okabe and Ito's colours, told apart by colour-blind readers; a method or integrator not listed gets a spare one.
COLOURS = {"jacobi": "#0072B2", "gauss-seidel": "#009E73", "direct": "#D55E00", NO_METHOD: "#CC79A7"}
SPARE_COLOURS = ("#E69F00", "#56B4E9", "#000000")
SHAPES = {"pbd": "o", "bdf2": "s", "midpoint": "^", "midpoint4": "D", "dop853": "*", "rk4": "P"}
SPARE_SHAPES = ("v", "p", "<", ">")
LARGER = {"*": 1.6}  # of shapes with little in them
DOUBTED, FAINT = 0.4, 0.13
"""Opacities: of what did not converge, and of what is on no front."""


def kind(row: Row) -> str:
    return "diverged" if failed(row) else row.outcome


def colours(rows: Iterable[Row]) -> dict[str, str]:
    return _assign(COLOURS, SPARE_COLOURS, {row.method for row in rows})


def shapes(rows: Iterable[Row]) -> dict[str, str]:
    return _assign(SHAPES, SPARE_SHAPES, {row.integrator for row in rows})


def _assign(known: dict[str, str], spare: Sequence[str], names: set[str]) -> dict[str, str]:
    """A colour or shape for each name, known names first, so that a name looks alike in every chart."""
    others = sorted(names - known.keys())
    signs = {name: sign for name, sign in known.items() if name in names}
    return signs | {name: spare[index % len(spare)] for index, name in enumerate(others)}


def look(kind: str, colour: str, shape: str, dtype: str, strong: bool) -> dict[str, Any]:
    """How rows are drawn. Hollow is larger than filled: of two in one place both are seen."""
    if kind == "diverged":
        return {
            "marker": "x",
            "color": colour,
            "linestyle": "none",
            "markersize": 4.0,
            "markeredgewidth": 0.8,
            "alpha": DOUBTED,
            "zorder": 3,
        }
    hollow = dtype == "float32"
    size = (7.5 if hollow else 5.0) * LARGER.get(shape, 1.0)
    return {
        "marker": shape,
        "color": colour,
        "linestyle": "none",
        "markerfacecolor": "none" if hollow else colour,
        "markersize": size if strong else 0.6 * size,
        "markeredgewidth": 0.9 if hollow else 0.0,
        "alpha": (DOUBTED if kind == "not converged" else 1.0) if strong else FAINT,
        "zorder": 4 if strong else 2.5,
    }


def keys(rows: Sequence[Row], with_peers: bool) -> list[tuple[str, list[Line2D]]]:
    """What the colours, shapes and marks in use mean: titles, each with its handles."""
    from matplotlib.lines import Line2D

    def key(label: str, **other: Any) -> Line2D:
        base: dict[str, Any] = {"linestyle": "none", "color": GREY, "markersize": 5.5, "markeredgewidth": 0.0}
        return Line2D([], [], label=label, **(base | other))

    dtypes, kinds = {row.dtype for row in rows}, set(map(kind, rows))
    marks = [
        ("float32" in dtypes, key("float32", **look("converged", GREY, "o", "float32", True))),
        (dtypes != {"float32"}, key("float64", marker="o")),
        (kinds != {"diverged"}, key("a method's own front", marker="o", linestyle="-", linewidth=0.7)),
        (True, key("its other settings", marker="o", markersize=3.5, alpha=2.0 * FAINT)),
        ("not converged" in kinds, key("not converged, or > 10 % stretched", marker="o", alpha=DOUBTED)),
        ("diverged" in kinds, key("diverged, at the top edge", **look("diverged", GREY, "", "", True))),
        (kinds != {"diverged"}, key(f"front of all: {LABEL}", linestyle="-", color=INK)),
        (any(row.wall_spread > 0.0 for row in rows), key("spread of the repetitions", linestyle="-", linewidth=0.9)),
        (with_peers, key("other simulators, best settings", linestyle="-", linewidth=2.0, alpha=0.6)),
    ]
    names = {NO_METHOD: "none needed"}
    return [
        ("Method", [key(names.get(name, name), marker="o", color=colour) for name, colour in colours(rows).items()]),
        ("Integrator", [key(name, marker=shape) for name, shape in shapes(rows).items()]),
        ("Mark", [handle for shown, handle in marks if shown]),
    ]
