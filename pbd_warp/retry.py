"""What to do with a frame that failed: `on_failure` of a simulation."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pbd_warp.errors import SimulationFailed
from pbd_warp.model.model import State

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation

ON_FAILURE = ("raise", "continue", "subdivide", "fallback")

DOUBLINGS = 4
""" "subdivide" goes up to 2^4 times the substeps."""

FALLBACKS = ("bdf2", "pbd")
"""Integrators that "fallback" goes through: ever more robust, ever less accurate."""


class FrameRetry:
    """Makes a failed frame again from its start, with settings that are more robust, in a simulation of its own.

    After it the simulation goes on with its own settings; integrator and method begin anew there, since what they
    remember belongs to another step length.
    """

    def __init__(self, sim: Simulation, on_failure: str):
        self._sim = sim
        self._on_failure = on_failure
        self._spare: dict[str, Simulation] = {}
        n = sim.model.particle_count
        self._start = State(x=sim.allocate("start.x", n, sim.vec3), v=sim.allocate("start.v", n, sim.vec3))

    def remember(self) -> None:
        """At the start of a frame."""
        self._sim.launch.copy(self._start.x, self._sim.state.x)
        self._sim.launch.copy(self._start.v, self._sim.state.v)

    def retry(self) -> bool:
        """Make the frame again, until an attempt succeeds."""
        sim = self._sim
        for attempt, changes in self._attempts():
            if attempt not in self._spare:
                self._spare[attempt] = sim.like(**changes, on_failure="raise")
            spare = self._spare[attempt]
            spare.take_over(sim, self._start)
            spare.frame -= 1
            try:
                spare.step()
            except SimulationFailed:
                continue
            sim.take_over(spare)
            return True
        return False

    @property
    def tried(self) -> str:
        """What it goes through, in words."""
        return ", ".join(attempt for attempt, _ in self._attempts()) or f"nothing more robust than {FALLBACKS[-1]!r}"

    def _attempts(self) -> Iterator[tuple[str, dict[str, Any]]]:
        sim = self._sim
        if self._on_failure == "subdivide":
            for doubling in range(1, DOUBLINGS + 1):
                substeps = sim.substeps * 2**doubling
                yield f"{substeps} substeps", {"substeps": substeps}
        else:
            own = sim.settings["integrator"]
            for integrator in FALLBACKS[FALLBACKS.index(own) + 1 if own in FALLBACKS else 0 :]:
                yield f"integrator {integrator!r}", {"integrator": integrator}
