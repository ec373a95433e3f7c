"""Where a prim is in the world."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from pbd_warp.curves.attributes import changes
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
        self.animated = _moves(prim, time_codes)
        for time_code in time_codes if self.animated else time_codes[:1]:
            self._check(float(time_code))

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


def _moves(prim: Usd.Prim, time_codes: np.ndarray) -> bool:
    """Whether it or anything that it is in is animated."""
    while prim and not prim.IsPseudoRoot():
        xform = UsdGeom.Xformable(prim)
        if xform and any(changes(op.GetAttr(), time_codes) for op in xform.GetOrderedXformOps()):
            return True
        prim = prim.GetParent()
    return False
