"""What ropes are made of: the command line, `pbd:*` attributes of their prims, physics materials, defaults."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from pxr import Usd

from pbd_warp import check
from pbd_warp.curves.attributes import own_setting
from pbd_warp.curves.physics import physics_material
from pbd_warp.errors import InputError

DENSITY = 1000.0
"""kg/m^3, that of water: a cable's or a plant's to a factor of 2."""

PINS = ("root", "ends", "none", "primvar:NAME")


@dataclass(frozen=True)
class Material:
    """Of the ropes of one prim. None: not said.

    pin: "root", "ends", "none" or "primvar:NAME". density [kg/m^3] or mass [kg] of each curve. compliance of each link
    [m/N].
    """

    pin: str | None = None
    density: float | None = None
    mass: float | None = None
    compliance: float | None = None

    def __post_init__(self) -> None:
        if self.pin is not None and self.pin not in PINS[:3] and not str(self.pin).startswith("primvar:"):
            raise InputError(f"pin must be {', '.join(PINS[:3])} or {PINS[3]}, not {self.pin!r}")
        if self.density is not None and self.mass is not None:
            raise InputError("density and mass both say how heavy a curve is: give one of the two")
        for name, value in (("density", self.density), ("mass", self.mass)):
            if value is not None:
                check.number(name, value, above=0.0)
        if self.compliance is not None:
            check.number("compliance", self.compliance, low=0.0)

    def of(self, prim: Usd.Prim, time_codes: np.ndarray) -> Material:
        """With what a prim's own attributes, and then its physics material, say where this says nothing, and else the
        defaults.

        Raises:
            InputError: a value that makes no sense, or changes with time.
        """
        said = {field.name: own_setting(prim, field.name, time_codes) for field in fields(self)}
        try:
            own = Material(**said)
        except InputError as error:
            raise InputError(f"pbd:{error}") from None
        heavy = own if self.density is None and self.mass is None else self
        if heavy.density is None and heavy.mass is None:
            heavy = Material(density=physics_material(prim, time_codes).density or DENSITY)
        return replace(
            self,
            pin=self.pin or own.pin or "root",
            density=heavy.density,
            mass=heavy.mass,
            compliance=next(value for value in (self.compliance, own.compliance, 0.0) if value is not None),
        )
