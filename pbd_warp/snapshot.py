"""What checks look at: a simulation, copied to the host."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd_warp.model.model import Model
from pbd_warp.settings import Settings


@dataclass(frozen=True)
class Snapshot:
    """A simulation at one moment, on the host.

    x, v: float64 [particle_count, 3] [m], [m/s]. w: Inverse masses [1/kg], 0 also for what is held. point_target:
    [point_count, 3] [m]. overlaps: How deep particles are in colliders, and in which; None where nobody knows.
    """

    model: Model
    settings: Settings
    x: np.ndarray
    v: np.ndarray
    w: np.ndarray
    point_target: np.ndarray
    overlaps: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def before(self) -> Snapshot:
        """Of a simulation that has just failed: where its particles are then says nothing about why, so here they are
        where they began; but for those that are held, which are where they are led to."""
        x, v = self.model.x.copy(), self.model.v.copy()
        held = self.w == 0.0
        x[held] = np.nan_to_num(self.x[held])
        return Snapshot(self.model, self.settings, x, v, self.w, self.point_target)
