"""Watches a simulation for strands that pass through each other, frame by frame."""

from __future__ import annotations

import numpy as np

from pbd_warp.crossings import Crossing, find_crossings
from pbd_warp.model.model import Model


class CrossingWatch:
    """Compares each frame with the one before.

    Attributes:
        found: All passages since the watch began.
    """

    def __init__(self, model: Model, x: np.ndarray):
        self._link = model.distance.edge
        self._copy = self._link[:, 0] // model.copy_size
        self._before = x
        self.found: list[Crossing] = []

    def look(self, x: np.ndarray, frame: int) -> None:
        """Note the passages on the way to positions x [m], float64 [particle_count, 3], which are those of `frame`."""
        crossings = find_crossings(self._before, x, self._link, frame)
        self.found += [each for each in crossings if self._copy[each.links[0]] == self._copy[each.links[1]]]
        self._before = x
