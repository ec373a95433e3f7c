"""What a failed frame is reported as: what was found, with which settings, the worst constraint, the nearest remedy."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pbd_warp.errors import SimulationFailed
from pbd_warp.model.copies import copy_of
from pbd_warp.preflight import SMALLER_STEPS, Snapshot, nearest_remedy
from pbd_warp.step.constraints.contact import room_for_contacts

Failure = tuple[str, int]
"""What kind, and its number: ("particle", which), ("piece", its first particle), ("stretch", edge), ("energy", 0),
("newton", how many solutions), ("contacts", how many there were without room for them), or
("copies", 0): of which copies and what, the loop knows."""


def failed(
    when: str, now: Snapshot, failure: Failure, tried: str = "", missed: np.ndarray | None = None
) -> SimulationFailed:
    """The error about a frame that has just been made.

    Args:
        when: Which frame it is.
        tried: What was tried to save it.
        missed: Of each particle, solutions of its piece that did not converge, int [particle_count].
    """
    kind, number = failure
    if kind == "contacts" and number < 0:
        what = f"{when}: contacts touch {-number} particles of one connected piece, more than 'direct' couples"
        return SimulationFailed(what, remedy="use method 'gauss-seidel', or sample what touches more coarsely")
    if kind == "contacts":
        room = room_for_contacts(now.model.particle_count, now.settings.max_contacts)
        what = f"{when}: {number} contacts, but there is room for {room}"
        return SimulationFailed(what, remedy=f"give Simulation or Scene max_contacts={2 * number} or more")
    where = "; ".join(text for text in (f"with {now.settings}", _worst_constraint(now)) if text)
    remedy = "; ".join(text for text in (nearest_remedy(now) or _remedy(now, kind), tried) if text)
    what = f"{when}: {_finding(now, failure)}"
    if kind == "newton" and missed is not None and np.any((missed < missed.max()) & (now.w > 0.0)):
        what += f", most often of what is joined to particle {np.argmax(missed)}"
    return SimulationFailed(what, where=where, remedy=remedy)


def failed_copies(when: str, now: Snapshot, failures: Mapping[int, Failure], missed: np.ndarray) -> dict[int, str]:
    """One sentence about each copy that has failed, as if it were alone; its particles are numbered from 0."""

    def part(values: np.ndarray, k: int) -> np.ndarray:
        part: np.ndarray = values.reshape(now.model.copy_count, -1, *values.shape[1:])[k]
        return part

    def alone(k: int) -> Snapshot:
        x, v, w, target = (part(values, k) for values in (now.x, now.v, now.w, now.point_target))
        return Snapshot(copy_of(now.model, k), now.settings, x, v, w, target)

    return {k: str(failed(when, alone(k), failure, missed=part(missed, k))) for k, failure in failures.items()}


def _remedy(now: Snapshot, kind: str) -> str:
    """Where nothing known is near."""
    if kind == "newton":
        return (
            f"{SMALLER_STEPS}, on_failure='subdivide', which makes such frames again with smaller steps, or "
            "on_failure='continue', where what is left over does not matter"
        )
    if kind == "piece":
        cure = "use a larger error" if now.settings.auto else SMALLER_STEPS
        return f"if what holds them leaves them room, {cure}; if not, give them a compliance"
    return ", or ".join(text for text in (SMALLER_STEPS, now.settings.method.remedy) if text)


def _finding(now: Snapshot, failure: Failure) -> str:
    kind, number = failure
    if kind == "particle":
        return f"particle {number} has left the finite numbers"
    stretch, energy = now.settings.limits.stretch, now.settings.limits.energy
    if kind == "stretch" and stretch is not None:
        return f"distance {number} is stretched beyond the limit of {100 * stretch:g} %"
    if kind == "piece":
        return f"there is no step by which the particles joined to particle {number} keep their lengths"
    if kind == "energy":
        return f"energy rose beyond the limit of {energy:g} J above the start"
    return f"Newton's method did not converge in {number} solution{'s' if number > 1 else ''}"


def _worst_constraint(now: Snapshot) -> str:
    """The constraint that is furthest off, among those whose particles are finite; nothing where there is none."""
    edges, points = now.model.distance, now.model.point
    with np.errstate(all="ignore"):
        off = np.concatenate([np.abs(edges.residual(now.x)), points.residual(now.x, now.point_target)])
    c = np.nan_to_num(off, nan=-1.0, posinf=-1.0)
    if not len(c) or c.max() < 0.0:
        return ""
    worst = int(np.argmax(c))
    if worst >= len(edges):
        particle = points.particle[worst - len(edges)]
        return f"the worst constraint is the point of particle {particle}, off by {c[worst]:.3g} m"
    i, j = edges.edge[worst]
    rest = edges.rest_length[worst]
    relative = f" ({100 * c[worst] / rest:.3g} % of its length)" if rest > 0.0 else ""
    return f"the worst constraint is the distance of particles {i} and {j}, off by {c[worst]:.3g} m{relative}"
