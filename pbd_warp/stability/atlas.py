"""Measures maps, and keeps what was measured as CSV."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pbd_warp.accuracy.sweep import provenance
from pbd_warp.errors import InputError, SimulationFailed, unknown
from pbd_warp.model.builder import find_device
from pbd_warp.stability.classify import NUMBERS, OUTCOMES, Figures, classify
from pbd_warp.stability.map import Map
from pbd_warp.table import TableRow, load_table, save_table
from pbd_warp.workers import Lost, Pool, ThisProcess

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
    return _measure_cell(made.panels[panel].cell, panel, x, y)


def _measure_cells(run: Mapping[tuple[str, str], Run], places: Sequence[tuple[str, str, float, float]]) -> list[Cell]:
    """Run cells (map, panel, x, y) by what each panel runs: all of the maps that travels to workers."""
    return [_measure_cell(run[name, panel], panel, x, y) for name, panel, x, y in places]


def _measure_cell(run: Run, panel: str, x: float, y: float) -> Cell:
    try:
        figures = run(x, y)
        outcome = classify(figures)
    except InputError:
        figures, outcome = Figures(), REFUSED
    numbers = {name: float(f"{getattr(figures, name):.4g}") for name in NUMBERS}
    return Cell(panel=panel, x=x, y=y, outcome=outcome, **numbers)


def measure_maps(
    maps: Sequence[Map],
    on_cell: Callable[[], object] = lambda: None,
    pool: Pool = ThisProcess(),  # noqa: B008 it has no state
    tick: Callable[[], object] = lambda: None,
) -> Iterator[Measured]:
    """Run every cell of some maps, and give each map when it is complete.

    Args:
        on_cell: Called after each.
        pool: Who runs them; no worker waits for the end of a map.
        tick: Called several times a second; what it raises ends the run.
    """
    run = {(made.name, name): panel.cell for made in maps for name, panel in made.panels.items()}
    places = [(made.name, *place) for made in maps for place in places_of(made)]
    cells: dict[str, dict[tuple[str, float, float], Cell]] = {made.name: {} for made in maps}
    by_name = {made.name: made for made in maps}
    for number, cell in pool.run(partial(_measure_cells, run), places, tick):
        name, *place = places[number]
        if isinstance(cell, Lost):
            raise SimulationFailed(f"cell {place} of the map {name} has killed its worker repeatedly")
        cells[name][cell.panel, cell.x, cell.y] = cell
        on_cell()
        if len(cells[name]) == by_name[name].size:
            made = by_name[name]
            info = {"map": name, "scene": made.scene, "x": made.x.name, "y": made.y.name}
            info |= provenance(str(find_device(None)))
            yield Measured(made, tuple(cells[name][place] for place in places_of(made)), info)


def measure_map(made: Map, on_cell: Callable[[], object] = lambda: None, pool: Pool = ThisProcess()) -> Measured:  # noqa: B008
    """Run every cell of one map, as `measure_maps`."""
    return next(measure_maps([made], on_cell, pool))


def places_of(made: Map) -> list[tuple[str, float, float]]:
    """(panel, x, y) of each cell."""
    return [(panel, float(x), float(y)) for panel in made.panels for x in made.x.values for y in made.y.values]


def save(measured: Measured, path: Path) -> None:
    """Write the cells as CSV, the info as leading lines."""
    save_table("a map", COLUMNS, measured.cells, measured.info, path)


def load(made: Map, path: Path) -> Measured:
    """Read what `save` wrote of a map.

    Raises:
        InputError: it cannot be read, or its cells are not those of the map.
    """
    cells, info = load_table("the map", Cell, path)
    wanted = set(places_of(made))
    if {(cell.panel, cell.x, cell.y) for cell in cells} != wanted or len(cells) != len(wanted):
        raise InputError(f"{path}: its cells are not those of the map {made.name}: measure it again")
    return Measured(made, cells, info)
