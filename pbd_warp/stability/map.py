"""What a map of the atlas is made of."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from pbd_warp.preflight import REMEDIES
from pbd_warp.stability.classify import OUTCOMES, Figures

FAILURES = frozenset(OUTCOMES) - {"converged"}


@dataclass(frozen=True)
class Axis:
    """What is varied: `name` as it is written at the axis, `values` ascending; `log`: evenly spaced in ratio."""

    name: str
    values: tuple[float, ...]
    log: bool = False

    def place(self, value: float) -> float:
        """Where a value lies, in cells: 0 at the middle of the first; beyond both ends on as between the last two."""
        scale = np.log if self.log else np.asarray
        at, known = float(scale(value)), np.asarray(scale(self.values))
        k = int(np.clip(np.searchsorted(known, at) - 1, 0, len(known) - 2))
        return k + (at - known[k]) / (known[k + 1] - known[k])

    def value(self, place: float) -> float:
        """The value at a place between the first cell and the last."""
        scale, back = (np.log, np.exp) if self.log else (np.asarray, np.asarray)
        return float(back(np.interp(place, np.arange(len(self.values)), scale(self.values))))


@dataclass(frozen=True)
class Boundary:
    """Where theory says that a panel's cells begin to fail.

    of: y of the boundary at x; with along="y" x at y.
    formula: As it is written on the picture.
    fails: "above" or "below" that value.
    outcomes: The failures that theory speaks of.
    """

    of: Callable[[float], float]
    formula: str
    fails: str = "above"
    along: str = "x"
    outcomes: frozenset[str] = FAILURES


@dataclass(frozen=True)
class Panel:
    """Settings that are drawn as one panel: what a cell at (x, y) runs, and the boundary where theory has one.

    A cell gives its figures, or raises InputError where its settings are refused.
    """

    cell: Callable[[float, float], Figures]
    boundary: Boundary | None = None


@dataclass(frozen=True)
class Map:
    """Two parameters of a scene swept against each other, in a panel for each of some settings.

    scene: The scene's name. panels: by what is written above them. text: What the map shows.
    shade: A number of `Figures` that is written in cells that converged, and shades them.
    """

    name: str
    title: str
    scene: str
    x: Axis
    y: Axis
    panels: Mapping[str, Panel]
    text: str
    shade: str | None = None

    @property
    def remedy(self) -> str:
        """What helps there, one clause."""
        return REMEDIES[self.name]

    @property
    def size(self) -> int:
        """Cells of all panels."""
        return len(self.panels) * len(self.x.values) * len(self.y.values)

    def distance(self, panel: str, x: float, y: float) -> float:
        """How many cells lie between a cell and the panel's boundary, positive on the failing side."""
        boundary = self.panels[panel].boundary
        assert boundary is not None
        if boundary.along == "x":
            off = self.y.place(y) - self.y.place(boundary.of(x))
        else:
            off = self.x.place(x) - self.x.place(boundary.of(y))
        return off if boundary.fails == "above" else -off
