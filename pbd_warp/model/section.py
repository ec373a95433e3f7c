"""What a rope is made of, where it has a thickness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd_warp import check


@dataclass(frozen=True)
class RoundSection:
    """A full round section of one material; its numbers make a rope's mass, compliance and resistance to bending.

    radius [m], youngs_modulus E [Pa], density [kg/m^3], all above 0.

    Raises:
        InputError: one that is not, or not finite.
    """

    radius: float
    youngs_modulus: float
    density: float

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            object.__setattr__(self, name, check.number(f"{name} of a section", value, above=0.0))

    @property
    def area(self) -> float:
        """A [m^2]."""
        return float(np.pi * self.radius**2)

    @property
    def bending(self) -> float:
        """B = E I [N m^2], with I = pi r^4 / 4."""
        return self.youngs_modulus * float(np.pi) * self.radius**4 / 4.0

    def compliance(self, length: np.ndarray) -> np.ndarray:
        """Of links of these lengths [m/N]: l / (E A)."""
        return length / (self.youngs_modulus * self.area)

    def mass(self, length: np.ndarray) -> float:
        """Of all links of these lengths together [kg]."""
        return float(self.density * self.area * np.sum(length))
