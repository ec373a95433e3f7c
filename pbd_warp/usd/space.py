"""From the space of models, metres with y up, to that of a file."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import UsdGeom

from pbd_warp import check
from pbd_warp.errors import unknown

TO_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""Of row vectors: y becomes z, z becomes -y."""


class Space:
    """Of a file.

    Args:
        up_axis: "Y" or "Z". meters_per_unit: above 0.

    Raises:
        InputError: another axis or unit.
    """

    def __init__(self, up_axis: str = "Y", meters_per_unit: float = 1.0):
        if up_axis not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
            raise unknown("up axis", up_axis, (UsdGeom.Tokens.y, UsdGeom.Tokens.z))
        self.up_axis = up_axis
        self.meters_per_unit = check.number("meters_per_unit", meters_per_unit, above=0.0)
        self._turned = up_axis == UsdGeom.Tokens.z

    def __call__(self, vectors: np.ndarray) -> np.ndarray:
        """Positions [m] or velocities [m/s], shape [..., 3], as the file has them; without a change the same array."""
        turned = self.turn(vectors)
        return turned if self.meters_per_unit == 1.0 else turned / self.meters_per_unit

    def turn(self, vectors: np.ndarray) -> np.ndarray:
        """Directions."""
        return vectors @ TO_Z_UP if self._turned else vectors

    def back(self, vectors: np.ndarray) -> np.ndarray:
        """Positions of the file in metres, y up."""
        return self.meters_per_unit * (vectors @ TO_Z_UP.T if self._turned else vectors)

    def length(self, metres: Any) -> Any:
        """A length, or an array of them."""
        return metres / self.meters_per_unit
