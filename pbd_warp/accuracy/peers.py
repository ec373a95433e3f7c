"""What other simulators need for the same scene: measured by benchmarks/peers.py."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pbd_warp.table import TableRow, load_table, save_table

OURS = "pbd-warp"
NAMES = {"mujoco": "MuJoCo", "newton": "Newton", "pypbd": "pyPBD", "pyelastica": "PyElastica"}


@dataclass(frozen=True, eq=False)
class PeerRow(TableRow):
    """One measured configuration of one simulator; the fields are the columns of the CSV.

    scene: As in the charts; "chain of N links" for those that are in none.
    steps: A frame; of "auto", the digits of the error that it was asked for. 0: it could not be measured, and `outcome`
        says why.
    wall_ms_per_sim_second: Median of the rounds [ms].
    position_error: Root mean square over particles against the reference [m].
    outcome: "measured", or what went wrong.
    """

    scene: str
    peer: str
    settings: str
    steps: int
    wall_ms_per_sim_second: float
    wall_spread: float
    position_error: float
    outcome: str


def save(rows: list[PeerRow], info: dict[str, str], path: str | Path) -> None:
    save_table("a comparison", tuple(PeerRow.parsers()), rows, info, path)


def load(path: str | Path) -> tuple[tuple[PeerRow, ...], dict[str, str]]:
    """Read what `save` wrote: the rows and the info."""
    return load_table("the comparison", PeerRow, path)


def front(rows: tuple[PeerRow, ...], scene: str, peer: str) -> list[PeerRow]:
    """What is best of a peer: ascending in time, strictly descending in error."""
    able = [r for r in rows if r.scene == scene and r.peer == peer and math.isfinite(r.position_error)]
    best: list[PeerRow] = []
    for row in sorted(able, key=lambda r: (r.wall_ms_per_sim_second, r.position_error)):
        if not best or row.position_error < best[-1].position_error:
            best.append(row)
    return best


def fronts(rows: Sequence[PeerRow]) -> dict[str, list[PeerRow]]:
    """What is best of each other simulator that got somewhere, on the scene of the rows, by its name."""
    names = dict.fromkeys(row.peer for row in rows if row.peer != OURS)
    found = {name: front(tuple(rows), rows[0].scene, name) for name in names}
    return {name: line for name, line in found.items() if line}
