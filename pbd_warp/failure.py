"""What a failed frame is reported as: what was found, with which settings, the worst constraint, the nearest remedy."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pbd_warp.preflight import nearest_remedy

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation

Failure = tuple[str, int]
"""What kind, and its number: ("particle", which), ("stretch", edge), ("energy", 0), ("newton", how many solutions)."""


def describe(sim: Simulation, failure: Failure) -> str:
    """One sentence about the frame that the simulation has just made."""
    settings = f"{sim.method}, integrator {sim.settings['integrator']!r} and {sim.substeps} substeps"
    remedy = nearest_remedy(sim) or _remedy(sim, failure[0])
    return (
        f"frame {sim.frame} (t = {sim.time:.6g} s): {_finding(sim, failure)} with {settings}; "
        f"{_worst_constraint(sim)}{remedy}"
    )


def _remedy(sim: Simulation, kind: str) -> str:
    """Where nothing known is near."""
    if kind == "newton":
        return (
            "use more substeps, on_failure='subdivide', which makes such frames again with smaller steps, or "
            "'continue', where what is left over does not matter"
        )
    return sim.method.remedy


def _finding(sim: Simulation, failure: Failure) -> str:
    kind, number = failure
    limits = sim.settings["limits"]
    if kind == "particle":
        return f"particle {number} has left the finite numbers"
    if kind == "stretch":
        return f"distance {number} is stretched beyond the limit of {100 * limits.stretch:g} %"
    if kind == "energy":
        return f"energy rose beyond the limit of {limits.energy:g} J above the start"
    return f"Newton's method did not converge in {number} solution{'s' if number > 1 else ''}"


def _worst_constraint(sim: Simulation) -> str:
    """The constraint that is furthest off, among those whose particles are finite; nothing where there is none."""
    x = sim.state.x.numpy().astype(np.float64)
    edges, points = sim.model.distance, sim.model.point
    with np.errstate(all="ignore"):
        off = [np.abs(edges.residual(x))]
        if sim.point_target is not None:
            off.append(points.residual(x, sim.point_target.numpy()))
    c = np.nan_to_num(np.concatenate(off), nan=-1.0, posinf=-1.0)
    if not len(c) or c.max() < 0.0:
        return ""
    worst = int(np.argmax(c))
    if worst >= len(edges):
        particle = points.particle[worst - len(edges)]
        return f"the worst constraint is the point of particle {particle}, off by {c[worst]:.3g} m; "
    i, j = edges.edge[worst]
    rest = edges.rest_length[worst]
    relative = f" ({100 * c[worst] / rest:.3g} % of its length)" if rest > 0.0 else ""
    return f"the worst constraint is the distance of particles {i} and {j}, off by {c[worst]:.3g} m{relative}; "
