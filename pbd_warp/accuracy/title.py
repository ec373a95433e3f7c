"""What a chart shows, in a sentence made of its rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby

from pbd_warp.accuracy.chart import Row, pick
from pbd_warp.accuracy.peers import NAMES, OURS, PeerRow, front

DECADES = tuple(10.0**-k for k in range(1, 13))
"""Errors that are asked for [m]."""

COMPARED = (1e-3, 1e-5, 1e-7, 1e-9)
"""Errors at which others are compared; the title has the last but one that any of them reaches."""


def seen(rows: Sequence[Row]) -> str:
    """Which method and integrator are fastest within which errors."""
    winners = [(error, row.name) for error in DECADES if (row := pick(rows, error))]
    if not winners:
        return "nothing came to an end"
    spans = []
    for name, group in groupby(winners, key=lambda winner: winner[1]):
        errors = [error for error, _ in group]
        to = f" to {errors[-1]:g}" if len(errors) > 1 else ""
        spans.append(f"{name} ({errors[0]:g}{to} m)")
    return f"fastest within an error: {'; '.join(spans)}"


def seen_of_peers(peers: Iterable[PeerRow]) -> str:
    """How much longer than ours the others take within an error that some of them reach."""
    rows = tuple(peers)
    if not rows:
        return ""
    scene = rows[0].scene
    others = [name for name in dict.fromkeys(row.peer for row in rows) if name != OURS]

    def fastest(name: str, error: float) -> float | None:
        within = [row for row in front(rows, scene, name) if row.position_error <= error]
        return within[0].wall_ms_per_sim_second if within else None

    reached = [e for e in COMPARED if fastest(OURS, e) and any(fastest(name, e) for name in others)]
    if not reached:
        return ""
    error = reached[-1]
    own = fastest(OURS, error)
    assert own is not None
    times = {NAMES[name]: fastest(name, error) for name in others}
    there = [f"{name} takes {_rounded(time / own)} times as long" for name, time in times.items() if time]
    short = [name for name, time in times.items() if not time]
    said = ", ".join(there) + (f"; {', '.join(short)} {'do' if short[1:] else 'does'} not get there" if short else "")
    return f"Within {error:g} m {said}."


def _rounded(value: float) -> str:
    """Two digits of it, written out."""
    return f"{float(f'{value:.2g}'):g}"
