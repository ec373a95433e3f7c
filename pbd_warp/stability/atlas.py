"""Measures maps, and keeps what was measured as CSV."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pbd_warp.accuracy.sweep import provenance
from pbd_warp.errors import InputError, SimulationFailed, unknown
from pbd_warp.model.builder import find_device
from pbd_warp.stability.classify import NUMBERS, OUTCOMES, Figures, classify
from pbd_warp.stability.map import Map
from pbd_warp.study.workers import Lost, Pool, ThisProcess
from pbd_warp.table import TableRow, load_table, save_table

REFUSED = "refused"

Run = Callable[[float, float], Figures]
"""What the cell at (x, y) of a panel runs."""


@dataclass(frozen=True, eq=False)
class Cell(TableRow):
    """One measured cell; the fields are the columns of the CSV. outcome: one of OUTCOMES. The others: see Figures."""

    panel: str
    x: float
    y: float
    outcome: str
    energy_gain: float
    stretch: float
    left: float
    error: float
    iterations: float

    def __post_init__(self) -> None:
        if self.outcome not in OUTCOMES:
            raise unknown("outcome", self.outcome, OUTCOMES)


COLUMNS = tuple(Cell.parsers())


@dataclass(frozen=True)
class Measured:
    """All cells of a map, panel by panel, and what they were made with."""

    map: Map
    cells: tuple[Cell, ...]
    info: dict[str, str]

    def panel(self, name: str) -> dict[tuple[float, float], Cell]:
        """The cells of a panel by (x, y)."""
        return {(cell.x, cell.y): cell for cell in self.cells if cell.panel == name}

    def beside_theory(self, name: str) -> list[Cell]:
        """Cells of a panel that are more than one cell away from its boundary and on the wrong side of it."""
        boundary = self.map.panels[name].boundary
        if boundary is None:
            return []
        return [
            cell
            for cell in self.panel(name).values()
            if abs(off := self.map.distance(name, cell.x, cell.y)) > 1.0
            and (cell.outcome in boundary.outcomes) != (off > 0.0)
        ]


def measure_cell(made: Map, panel: str, x: float, y: float) -> Cell:
    """Run one cell of a map."""
    return _measure_cells({panel: made.panels[panel].cell}, [(panel, x, y)])[0]


def _measure_cells(run: Mapping[str, Run], places: list[tuple[str, float, float]]) -> list[Cell]:
    """Run cells (panel, x, y) by what each panel runs: all of a map that travels to workers."""
    return [_measure_cell(run[panel], panel, x, y) for panel, x, y in places]


def _measure_cell(run: Run, panel: str, x: float, y: float) -> Cell:
    try:
        figures = run(x, y)
        outcome = classify(figures)
    except InputError:
        figures, outcome = Figures(), REFUSED
    numbers = {name: float(f"{getattr(figures, name):.4g}") for name in NUMBERS}
    return Cell(panel=panel, x=x, y=y, outcome=outcome, **numbers)


def measure_map(
    made: Map,
    on_cell: Callable[[], object] = lambda: None,
    pool: Pool = ThisProcess(),  # noqa: B008 it has no state
    tick: Callable[[], object] = lambda: None,
) -> Measured:
    """Run every cell of a map.

    Args:
        on_cell: Called after each.
        pool: Who runs them.
        tick: Called several times a second; what it raises ends the map.
    """
    places = [(panel, float(x), float(y)) for panel in made.panels for x in made.x.values for y in made.y.values]
    cells: dict[int, Cell] = {}
    run = {name: panel.cell for name, panel in made.panels.items()}
    for number, cell in pool.run(partial(_measure_cells, run), places, tick):
        if isinstance(cell, Lost):
            raise SimulationFailed(f"cell {places[number]} of the map {made.name} has killed its worker repeatedly")
        cells[number] = cell
        on_cell()
    info = {
        "map": made.name,
        "scene": made.scene,
        "x": made.x.name,
        "y": made.y.name,
        **provenance(str(find_device(None))),
    }
    return Measured(made, tuple(cells[number] for number in range(len(places))), info)


def save(measured: Measured, path: Path) -> None:
    """Write the cells as CSV, the info as leading lines."""
    save_table("a map", COLUMNS, measured.cells, measured.info, path)


def load(made: Map, path: Path) -> Measured:
    """Read what `save` wrote of a map.

    Raises:
        InputError: it cannot be read, or its cells are not those of the map.
    """
    cells, info = load_table("the map", Cell, path)
    wanted = {(panel, float(x), float(y)) for panel in made.panels for x in made.x.values for y in made.y.values}
    if {(cell.panel, cell.x, cell.y) for cell in cells} != wanted or len(cells) != len(wanted):
        raise InputError(f"{path}: its cells are not those of the map {made.name}: measure it again")
    return Measured(made, cells, info)
