"""Notices within a frame that a simulation has diverged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.kernels.divergence import CHUNK, check_energy, check_stretch, sum_energy
from pbd_warp.model.model import Model
from pbd_warp.step.context import Context

STRETCHED = 0.1
"""A rigid link further off its length, or two particles deeper inside each other, than this fraction of it count as a
failure of the method, whatever it says of itself: in charts, in the atlas and in preflight checks."""


@dataclass(frozen=True)
class Limits:
    """Beyond these a frame counts as diverged, as it does when a position is not finite.

    stretch: Of a distance, relative to its rest length: 10 is eleven times as long. None: no limit.
    energy: Rise of the kinetic energy and that in gravity over the initial state's [J]. None: no limit. A drag that
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


def energy_of(model: Model) -> np.ndarray:
    """Kinetic energy and that in gravity of each particle at the start [J]."""
    return model.mass * (0.5 * np.sum(model.v**2, axis=1) - model.x @ model.gravity)


class DivergenceMonitor:
    """Compares a frame with the limits, in its last launches."""

    def __init__(self, context: Context, limits: Limits):
        self._context = context
        model = context.model
        self._stretch_limit = None
        if limits.stretch is not None and len(model.distance):
            self._stretch_limit = (1.0 + limits.stretch) ** 2
            self._edge = context.upload("divergence.edge", model.distance.edge, wp.vec2i)
            self._rest_length = context.upload("divergence.rest_length", model.distance.rest_length)
        self.energy_limit = None
        if limits.energy is not None:
            self.energy_limit = float(energy_of(model).sum()) + limits.energy
            self._mass = context.upload("divergence.mass", model.mass)
            self._energy = context.allocate("divergence.energy", 1, wp.float64)

    def restart(self) -> None:
        """Forget what was found."""
        self._context.forget_divergence()

    def launch(self) -> None:
        """At the end of a frame."""
        context = self._context
        x = context.state.x
        if self._stretch_limit is not None:
            context.launch(
                check_stretch, len(self._edge), self._edge, self._rest_length, x, self._stretch_limit, context.diverged
            )
        if self.energy_limit is not None:
            chunks = -(-len(x) // int(CHUNK))
            context.launch(sum_energy, chunks, context.gravity, self._mass, x, context.state.v, self._energy)
            context.launch(check_energy, 1, self.energy_limit, self._energy, context.diverged)
