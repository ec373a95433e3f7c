"""Notices within a frame that a simulation has diverged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.kernels.divergence import CHUNK, sum_energy, watch_energy, watch_stretch

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation

NOTHING = np.iinfo(np.int32).max
"""In `diverged`: nothing to tell."""


@dataclass(frozen=True)
class Limits:
    """Beyond these a frame counts as diverged, as it does when a position is not finite.

    stretch: Of a distance, relative to its rest length: 10 is eleven times as long. None: no limit.
    energy: Rise of the kinetic energy and that in gravity over the initial state's [J]. None: no limit. A hand that
        moves a particle does work too, so only a scene knows how much there can be.

    Raises:
        InputError: a limit that is not above 0.
    """

    stretch: float | None = 10.0
    energy: float | None = None

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if value is not None:
                check.number(f"limit of {name}", value, above=0.0)


class DivergenceMonitor:
    """The limits of one simulation; `diverged` is what its frame has found: a particle, an edge, 0 for energy."""

    def __init__(self, sim: Simulation, limits: Limits):
        self._sim = sim
        model = sim.model
        self.diverged = sim.upload("diverged", [NOTHING] * 3, wp.int32)
        self._stretch_limit = None
        if limits.stretch is not None and len(model.distance):
            self._stretch_limit = (1.0 + limits.stretch) ** 2
            self._edge = sim.upload("watch.edge", model.distance.edge, wp.vec2i)
            self._rest_length = sim.upload("watch.rest_length", model.distance.rest_length)
        self.energy_limit = None
        if limits.energy is not None:
            free = model.w > 0.0
            mass = np.divide(1.0, model.w, out=np.zeros_like(model.w), where=free)
            start = mass @ (0.5 * np.sum(model.v**2, axis=1) - model.x @ model.gravity)
            self.energy_limit = float(start) + limits.energy
            self._mass = sim.upload("watch.mass", mass)
            self._energy = sim.allocate("watch.energy", 1, wp.float64)

    def restart(self) -> None:
        self.diverged.fill_(NOTHING)

    def launch(self) -> None:
        """At the end of a frame."""
        sim = self._sim
        x = sim.state.x
        if self._stretch_limit is not None:
            sim.launch(
                watch_stretch, len(self._edge), self._edge, self._rest_length, x, self._stretch_limit, self.diverged
            )
        if self.energy_limit is not None:
            gravity = sim.vec3(*sim.model.gravity)
            chunks = -(-len(x) // int(CHUNK))
            sim.launch(sum_energy, chunks, gravity, self._mass, x, sim.state.v, self._energy)
            sim.launch(watch_energy, 1, self.energy_limit, self._energy, self.diverged)
