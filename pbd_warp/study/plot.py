"""Draws a study: one column against another, a colour for each value of a third."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from pbd_warp.accuracy.plot import check_picture
from pbd_warp.errors import InputError, unknown

DECADES = 1.5
"""An axis whose numbers, all above 0, span more is logarithmic."""


def plot(frame: Any, x: str, y: str, hue: str | None, path: Path, title: str = "") -> None:
    """Draw the finished rows of a study; where several share x and hue, their median, and a band from least to most.

    Args:
        frame: A pandas.DataFrame, as `study` gives it.
        x, y, hue: Names of columns; x and y of numbers.
        path: .svg or .png.

    Raises:
        InputError: no such column, one that is not numbers, no finished rows.
    """
    form = check_picture(path)
    for name in (x, y, *([hue] if hue else [])):
        if name not in frame.columns:
            raise unknown("column", name, frame.columns)
    for name in (x, y):
        if frame[name].dtype.kind not in "fiu":
            raise InputError(f"column {name} is not of numbers, so it is no axis; it may be --hue")
    rows = frame[frame["outcome"] == "finished"].dropna(subset=[x, y])
    if rows.empty:
        raise InputError(f"no row is finished and has both {x} and {y}")
    import matplotlib.style
    from matplotlib.figure import Figure

    with matplotlib.style.context(["default", {"svg.hashsalt": "pbd-warp", "svg.fonttype": "none"}]):
        figure = Figure(figsize=(7.0, 4.6), layout="constrained")
        axes = figure.add_subplot(
            xlabel=x, ylabel=y, title=title, xscale=_scale(rows[x].to_list()), yscale=_scale(rows[y].to_list())
        )
        for value, group in [(None, rows)] if hue is None else rows.groupby(hue, sort=True):
            of_x = group.groupby(x, sort=True)[y]
            median = of_x.median()
            (line,) = axes.plot(
                median.index.to_numpy(), median.to_numpy(), marker="o", markersize=3.5, label=str(value)
            )
            if of_x.size().max() > 1:
                band = {"alpha": 0.2, "linewidth": 0.0, "color": line.get_color()}
                axes.fill_between(median.index.to_numpy(), of_x.min().to_numpy(), of_x.max().to_numpy(), **band)
        if hue is not None:
            axes.legend(title=hue, fontsize="small")
        axes.grid(alpha=0.3)
        figure.savefig(path, format=form, dpi=150, metadata={"Date": None} if form == "svg" else None)


def _scale(values: list[float]) -> str:
    finite = [value for value in values if math.isfinite(value)]
    wide = finite and min(finite) > 0.0 and math.log10(max(finite) / min(finite)) > DECADES
    return "log" if wide else "linear"
