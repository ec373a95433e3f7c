"""A chart of speed against accuracy: its rows, kept as CSV, and their Pareto front.

Nothing is measured here (`pbd_warp.accuracy.sweep` makes the rows) and nothing drawn (`pbd_warp.accuracy.plot`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pbd_warp.errors import unknown
from pbd_warp.settings import AUTO, Settings
from pbd_warp.step.methods import METHODS, Direct
from pbd_warp.table import TableRow, load_table, save_table

NO_METHOD = "none"
OUTCOMES = ("converged", "not converged", "diverged")


@dataclass(frozen=True, eq=False)
class Row(TableRow):
    """One measured configuration; the fields are the columns of the CSV, in their order.

    method: "none" of an integrator that takes none.
    substeps: Of a frame; where the integrator chose them, the most that it took in one.
    error: What it was asked to keep where it chose them [m/s]; 0 where it did not.
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
    error: float
    wall_ms_per_sim_second: float
    wall_spread: float
    projections_per_sim_second: float
    position_error: float
    max_stretch: float
    energy_drift: float
    outcome: str

    @property
    def name(self) -> str:
        """Method and integrator in words."""
        return self.integrator if self.method == NO_METHOD else f"{self.method}, {self.integrator}"

    @property
    def label(self) -> str:
        """What the front is labelled with: LABEL."""
        if self.error > 0.0:
            return f"{self.error:.0e} m/s"
        sweeps = self.method not in (NO_METHOD, Direct.name)
        return f"{self.substeps}" + f"\N{MULTIPLICATION SIGN}{self.iterations}" * sweeps

    @property
    def options(self) -> dict[str, Any]:
        """The configuration as options of `pbd-warp run`, by name."""
        chosen = {name: getattr(self, name) for name in CONFIGURATION}
        if self.method == NO_METHOD:
            del chosen["method"], chosen["iterations"]
        if self.error > 0.0:
            chosen["substeps"] = AUTO
        else:
            del chosen["error"]
        return chosen

    def apply(self, settings: Settings) -> Settings:
        """Settings with the row's in their place; its dtype is the model's."""
        if self.error > 0.0:
            return settings.keeping(self.error)
        if self.method == NO_METHOD:
            return settings.changed(integrator=self.integrator, substeps=self.substeps)
        method = METHODS[self.method](iterations=self.iterations)
        return settings.changed(method=method, integrator=self.integrator, substeps=self.substeps)

    def __post_init__(self) -> None:
        if self.outcome not in OUTCOMES:
            raise unknown("outcome", self.outcome, OUTCOMES)


COLUMNS = tuple(Row.parsers())

CONFIGURATION = ("method", "integrator", "substeps", "iterations", "error", "dtype")
"""The columns that say how it was simulated."""

LABEL = "substeps\N{MULTIPLICATION SIGN}iterations, or the error kept"


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


def within(rows: Iterable[Row], error: float) -> list[Row]:
    """Rows that did not diverge and whose position_error is at most `error` [m], ascending in wall time."""
    able = [row for row in rows if not failed(row) and row.position_error <= error]
    timed = [row for row in able if math.isfinite(row.wall_ms_per_sim_second)]
    return sorted(timed, key=lambda row: (row.wall_ms_per_sim_second, row.position_error))


def pick(rows: Iterable[Row], error: float) -> Row | None:
    """The first of those `within` the error."""
    return next(iter(within(rows, error)), None)


def best_error(rows: Iterable[Row]) -> float:
    """The smallest position error there is [m], infinite where nothing was measured."""
    return min((row.position_error for row in front(rows)), default=float("inf"))


def flags(row: Row) -> str:
    """The row's configuration as flags of `pbd-warp run`."""
    return " ".join(f"--{name} {value}" for name, value in row.options.items())


def failed(row: Row) -> bool:
    return row.outcome == "diverged" or not math.isfinite(row.position_error)
