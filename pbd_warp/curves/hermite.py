"""HermiteCurves: cubic segments between points with tangents.

S(t) = (2t^3 - 3t^2 + 1) P_0 + (t^3 - 2t^2 + t) T_0 + (3t^2 - 2t^3) P_1 + (t^3 - t^2) T_1.
Source: UsdGeom.HermiteCurves.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pbd_warp.curves.sampling import Pattern, Weights

LINKS = 3
"""Simulated links a segment: the fewest that tell both its points and both its tangents."""


@dataclass(frozen=True)
class HermiteKind:
    """The curves of one HermiteCurves prim; counts: points (and tangents) of each curve, shape [curve_count]."""

    counts: np.ndarray
    tangents: ClassVar[bool] = True

    @property
    def varying_counts(self) -> np.ndarray:
        return self.counts

    @property
    def faults(self) -> dict[int, str]:
        bad = np.flatnonzero(self.counts < 2)
        return {c: f"it has {self.counts[c]} control points; a Hermite curve needs 2 or more" for c in bad.tolist()}

    def key(self, curve: int) -> Hashable:
        return int(self.counts[curve])

    def pattern(self, curve: int) -> Pattern:
        n = int(self.counts[curve])
        part = np.arange(LINKS * (n - 1) + 1) / LINKS
        begin = np.minimum(np.floor(part).astype(int), n - 2)
        t = part - begin
        index = np.stack([begin, n + begin, begin + 1, n + begin + 1], axis=1)
        weight = np.stack([2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t, 3 * t**2 - 2 * t**3, t**3 - t**2], axis=1)
        along = Weights(np.stack([begin, begin + 1], axis=1), np.stack([1.0 - t, t], axis=1))
        return Pattern(False, Weights(index, weight), along, along, np.arange(2 * n))
