"""Where text goes on a chart: places, and which of them hide least.

A place is a point of a panel, as fractions of its width and height.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Place = tuple[float, float]

SMALL = 7.0  # points
INK, GREY, PALE = "#222222", "#777777", "#e4e4e4"


@dataclass(frozen=True)
class Scale:
    """A logarithmic axis from 10^low to 10^high, with a strip inside each end for what has no finite logarithm."""

    low: float
    high: float

    STRIP = 0.07  # of the axis

    @classmethod
    def of(cls, values: Iterable[float]) -> Scale:
        logs = [math.log10(value) for value in values if 0.0 < value < math.inf] or [0.0]
        widen = max(0.0, 2.0 - (max(logs) - min(logs))) / 2.0  # two decades at least, so that ticks have numbers
        low, high = min(logs) - widen, max(logs) + widen
        strip = cls.STRIP / (1.0 - 2.0 * cls.STRIP) * (high - low)
        return Scale(low - strip, high + strip)

    @property
    def limits(self) -> tuple[float, float]:
        return 10.0**self.low, 10.0**self.high

    def place(self, value: float) -> float:
        """Where `value` is drawn, 0 to 1: 0 and below in the strip at the low end, nan and inf in the other."""
        if value <= 0.0:
            return self.STRIP / 2.0
        if not math.isfinite(value):
            return 1.0 - self.STRIP / 2.0
        return (math.log10(value) - self.low) / (self.high - self.low)


def shade_strip(axes: Axes, bottom: float, text: str, taken: Sequence[Place]) -> None:
    """Shade a strip at the top or bottom edge: what is drawn there is off the scale."""
    top = bottom + Scale.STRIP
    axes.fill([0, 1, 1, 0], [bottom, bottom, top, top], transform=axes.transAxes, color=PALE, alpha=0.5, zorder=0.5)
    write_beside(axes, text, bottom + Scale.STRIP / 2.0, 0.11, taken)


def write_beside(axes: Axes, text: str, y: float, width: float, taken: Sequence[Place]) -> None:
    """Write at the height y, as far right as nothing is in the way."""
    right = 0.99 - width / 2.0
    x, _ = emptiest([(right - 0.01 * i, y) for i in range(int(100 * (1.0 - width)))], (width, 0.03), taken)
    write(axes, x, y, text, ha="center", va="center")


def write(axes: Axes, x: float, y: float, text: str, **look: Any) -> None:
    base: dict[str, Any] = {"size": SMALL, "color": INK, "zorder": 5}
    axes.text(x, y, text, transform=axes.transAxes, **(base | look))


def along(line: Sequence[Place]) -> list[Place]:
    """Places so close together along a line that no text fits between them."""
    return [
        (a + (c - a) * i / 24, b + (d - b) * i / 24) for (a, b), (c, d) in itertools.pairwise(line) for i in range(25)
    ]


def emptiest(centres: Sequence[Place], box: Place, taken: Sequence[Place]) -> Place:
    """The centre at which a box keeps farthest from all that is taken; the first of those with room enough."""
    if not taken:
        return centres[0]
    gaps = np.abs(np.array(centres)[:, None] - np.array(taken)) - np.array(box) / 2.0  # shape [centres, taken, 2]
    room = np.minimum(np.hypot(*np.moveaxis(np.maximum(gaps, 0.0), -1, 0)).min(axis=1), 0.05)
    return centres[int(room.argmax())]
