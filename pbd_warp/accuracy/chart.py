"""A chart of speed against accuracy: its rows, kept as CSV, and their Pareto front.

Nothing is measured here (`pbd_warp.accuracy.sweep` makes the rows) and nothing drawn (`pbd_warp.accuracy.plot`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from pbd_warp.errors import unknown
from pbd_warp.settings import Settings
from pbd_warp.step.methods import METHODS
from pbd_warp.table import TableRow, load_table, save_table

OUTCOMES = ("converged", "not converged", "diverged")


@dataclass(frozen=True, eq=False)
class Row(TableRow):
    """One measured configuration; the fields are the columns of the CSV, in their order.

    wall_ms_per_sim_second: Median wall time for one simulated second [ms].
    wall_spread: (max - min) / median of the repetitions.
    projections_per_sim_second: Constraint projections for one simulated second [1/s], the same on any hardware.
    position_error: Distance to the reference [m]; nan or inf where the run diverged.
    max_stretch: Largest | |x_i - x_j| / rest_length - 1 |.
    energy_drift: Change of the total energy [J].
    outcome: One of OUTCOMES; "not converged": the method's own word, or a rigid link more than 10 % off its length.
    """

    scene: str
    method: str
    integrator: str
    dtype: str
    substeps: int
    iterations: int
    wall_ms_per_sim_second: float
    wall_spread: float
    projections_per_sim_second: float
    position_error: float
    max_stretch: float
    energy_drift: float
    outcome: str

    @property
    def label(self) -> str:
        """What the front is labelled with: LABEL."""
        return f"{self.substeps}\N{MULTIPLICATION SIGN}{self.iterations}"

    def apply(self, settings: Settings) -> Settings:
        """Settings with the row's in their place; its dtype is the model's."""
        method = METHODS[self.method](iterations=self.iterations)
        return settings.changed(method=method, integrator=self.integrator, substeps=self.substeps)

    def __post_init__(self) -> None:
        if self.outcome not in OUTCOMES:
            raise unknown("outcome", self.outcome, OUTCOMES)


COLUMNS = tuple(Row.parsers())

CONFIGURATION = ("method", "integrator", "substeps", "iterations", "dtype")
"""The columns that say how it was simulated."""

LABEL = "substeps\N{MULTIPLICATION SIGN}iterations"


@dataclass(frozen=True)
class Chart:
    """Rows of one sweep, and what they were made with.

    info: machine, versions, date and reference (one sentence: what position_error is measured against) are drawn
        under the picture; any other key is only kept in the file.
    """

    rows: tuple[Row, ...]
    info: dict[str, str]


def save(chart: Chart, path: str | Path) -> None:
    """Write the chart as CSV, its info as leading lines `# key: value`."""
    save_table("a chart", COLUMNS, chart.rows, chart.info, path)


def load(path: str | Path) -> Chart:
    """Read what `save` wrote."""
    return Chart(*load_table("the chart", Row, path))


def front(rows: Iterable[Row], cost: str = "wall_ms_per_sim_second") -> list[Row]:
    """The Pareto front of position_error against `cost`: ascending in cost, strictly descending in error.

    Diverged rows and those whose error or cost is not finite are never in it.
    """
    able = [row for row in rows if not failed(row) and math.isfinite(getattr(row, cost))]
    best: list[Row] = []
    for row in sorted(able, key=lambda row: (getattr(row, cost), row.position_error)):
        if not best or row.position_error < best[-1].position_error:
            best.append(row)
    return best


def pick(rows: Iterable[Row], error: float) -> Row | None:
    """The row of least wall time that did not diverge and whose position_error is at most `error` [m]."""
    return next((row for row in front(rows) if row.position_error <= error), None)


def best_error(rows: Iterable[Row]) -> float:
    """The smallest position error there is [m], infinite where nothing was measured."""
    return min((row.position_error for row in front(rows)), default=float("inf"))


def flags(row: Row) -> str:
    """The row's configuration as flags of `pbd-warp run`."""
    return " ".join(f"--{name} {getattr(row, name)}" for name in CONFIGURATION)


def failed(row: Row) -> bool:
    return row.outcome == "diverged" or not math.isfinite(row.position_error)
