"""A chart of speed against accuracy: its rows, kept as CSV, and their Pareto front.

Nothing is measured here (`pbd_warp.sweep` makes the rows) and nothing drawn (`pbd_warp.picture`).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pbd_warp.errors import InputError, unknown

if TYPE_CHECKING:
    pass

OUTCOMES = ("converged", "not converged", "diverged")


@dataclass(frozen=True, eq=False)
class Row:
    """One measured configuration; the fields are the columns of the CSV, in their order.

    wall_ms_per_sim_second: Median wall time for one simulated second [ms].
    wall_spread: (max - min) / median of the repetitions.
    projections_per_sim_second: Constraint projections for one simulated second [1/s], the same on any hardware.
    position_error: Distance to the reference [m]; nan or inf where the run diverged.
    max_stretch: Largest | |x_i - x_j| / rest_length - 1 |.
    energy_drift: Change of the total energy [J].
    outcome: One of OUTCOMES; "not converged": the method's own word, or a rigid link more than 10 % off its length.

    Rows are equal if they are written alike, so that nan equals nan.
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

    def cells(self) -> tuple[str, ...]:
        """The row as text, shape [len(COLUMNS)]; repr keeps every bit of a float."""
        values = [PARSERS[name](getattr(self, name)) for name in COLUMNS]
        return tuple(repr(value) if isinstance(value, float) else str(value) for value in values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Row) and self.cells() == other.cells()

    def __hash__(self) -> int:
        return hash(self.cells())


PARSERS: dict[str, Any] = {
    field.name: {"str": str, "int": int, "float": float}[str(field.type)] for field in fields(Row)
}
COLUMNS = tuple(PARSERS)
NOUNS = {str: "text", int: "a whole number", float: "a number"}


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
    for key, value in chart.info.items():
        if ":" in key or key != key.strip() or any(mark in key + value for mark in "\r\n"):
            raise InputError(f"a chart's info must fit one line 'key: value', not {key!r}: {value!r}")
    for row in chart.rows:
        if any(mark in cell for cell in row.cells() for mark in "\r\n"):
            raise InputError(f"a chart's row must fit one line, and that of scene {row.scene!r} does not")
    with open(path, "w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {key}: {value}\n" for key, value in chart.info.items())
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(row.cells() for row in chart.rows)


def load(path: str | Path) -> Chart:
    """Read what `save` wrote."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            lines = list(file)
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise InputError(f"cannot read the chart {path}: {reason}") from None
    info: dict[str, str] = {}
    while len(info) < len(lines) and lines[len(info)].startswith("#"):
        key, colon, value = lines[len(info)].removeprefix("#").rstrip("\r\n").partition(":")
        if not colon or key.strip() in info:
            raise InputError(f"{path}, line {len(info) + 1}: must be '# key: value', with each key once")
        info[key.strip()] = value.removeprefix(" ")
    reader = csv.reader(lines[len(info) :])
    try:
        header = next(reader, [])
        if tuple(header) != COLUMNS:
            missing = ", ".join(name for name in COLUMNS if name not in header)
            but = f"there is no {missing}" if missing else f"they are {', '.join(header)}"
            raise InputError(f"the columns must be {', '.join(COLUMNS)}, but {but}")
        rows = tuple(_parse(cells) for cells in reader if cells)
    except (csv.Error, ValueError) as error:
        raise InputError(f"{path}, line {len(info) + max(1, reader.line_num)}: {error}") from None
    if not rows:
        raise InputError(f"{path}: there are no rows under the columns")
    return Chart(rows, info)


def _parse(cells: list[str]) -> Row:
    if len(cells) != len(COLUMNS):
        raise InputError(f"there are {len(cells)} values for {len(COLUMNS)} columns")
    values = {}
    for (name, parse), cell in zip(PARSERS.items(), cells, strict=True):
        try:
            values[name] = parse(cell)
        except ValueError:
            raise InputError(f"{name} must be {NOUNS[parse]}, not {cell!r}") from None
    if values["outcome"] not in OUTCOMES:
        raise unknown("outcome", values["outcome"], OUTCOMES)
    return Row(**values)


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
    names = ("method", "integrator", "substeps", "iterations", "dtype")
    return " ".join(f"--{name} {getattr(row, name)}" for name in names)


def failed(row: Row) -> bool:
    return row.outcome == "diverged" or not math.isfinite(row.position_error)
