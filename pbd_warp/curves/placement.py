"""Where a prim is in the world."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from pbd_warp.errors import InputError


class Placement:
    """The local space of a prim in world space, in metres, at the frames of a simulation.

    Row vectors: world = local @ linear + offset.

    Attributes:
        animated: Whether it changes.

    Raises:
        InputError: at one of the frames it is flattened to less than space, so nothing can be brought back into it.
    """

    def __init__(self, prim: Usd.Prim, time_codes: np.ndarray):
        self._prim = prim
        self._unit = UsdGeom.GetStageMetersPerUnit(prim.GetStage())
        self._start = self._read(float(time_codes[0]))
        self.animated = False
        self._check(float(time_codes[0]))
        if _may_change(prim):
            for time_code in map(float, time_codes[1:]):
                self.animated |= not all(map(np.array_equal, self._read(time_code), self._start))
                self._check(time_code)

    def at(self, time_code: float) -> tuple[np.ndarray, np.ndarray]:
        """linear [3, 3], offset [3], in metres."""
        return self._read(time_code) if self.animated else self._start

    def _read(self, time_code: float) -> tuple[np.ndarray, np.ndarray]:
        matrix = UsdGeom.Imageable(self._prim).ComputeLocalToWorldTransform(time_code)
        matrix = np.array(matrix) * self._unit
        return matrix[:3, :3], matrix[3, :3]

    def _check(self, time_code: float) -> None:
        linear, offset = self._read(time_code)
        scale = np.linalg.norm(linear, axis=1).prod()
        flat = not np.isfinite(linear).all() or abs(np.linalg.det(linear)) <= 1e-9 * scale or scale == 0.0
        if flat or not np.isfinite(offset).all():
            raise InputError(
                f"its transform cannot be inverted at time code {time_code:g}: give it a scale above 0 in all axes"
            )


def _may_change(prim: Usd.Prim) -> bool:
    while prim and not prim.IsPseudoRoot():
        xform = UsdGeom.Xformable(prim)
        if xform and xform.TransformMightBeTimeVarying():
            return True
        prim = prim.GetParent()
    return False
