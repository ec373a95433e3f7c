"""What ropes are made of: the command line, `pbd:*` attributes of their prims, physics materials, defaults."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from pxr import Usd

from pbd_warp import check
from pbd_warp.curves.attributes import own_setting
from pbd_warp.curves.physics import physics_material
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.bending import REST_SHAPES

DENSITY = 1000.0
"""kg/m^3, that of water: a cable's or a plant's to a factor of 2."""

PINS = ("root", "ends", "none", "primvar:NAME")


@dataclass(frozen=True)
class Material:
    """Of the ropes of one prim. None: not said.

    pin: "root", "ends", "none" or "primvar:NAME". density [kg/m^3] or mass [kg] of each curve. compliance of each link
    [m/N]. Resistance to bending: youngs_modulus [Pa], widths being diameters, which gives a compliance too; or bending
    B [N m^2]; and rest_shape: "straight" or "as_built".
    """

    pin: str | None = None
    density: float | None = None
    mass: float | None = None
    compliance: float | None = None
    youngs_modulus: float | None = None
    bending: float | None = None
    rest_shape: str | None = None

    def __post_init__(self) -> None:
        if self.pin is not None and self.pin not in PINS[:3] and not str(self.pin).startswith("primvar:"):
            raise InputError(f"pin must be {', '.join(PINS[:3])} or {PINS[3]}, not {self.pin!r}")
        if self.density is not None and self.mass is not None:
            raise InputError("density and mass both say how heavy a curve is: give one of the two")
        if self.youngs_modulus is not None and self.bending is not None:
            raise InputError("youngs_modulus and bending both say how stiff a curve is: give one of the two")
        if self.rest_shape is not None and self.rest_shape not in REST_SHAPES:
            raise unknown("rest_shape", self.rest_shape, REST_SHAPES)
        stiff = {"youngs_modulus": self.youngs_modulus, "bending": self.bending}
        for name, value in {"density": self.density, "mass": self.mass, **stiff}.items():
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
        said = {field.name: own_setting(prim, camel_case(field.name), time_codes) for field in fields(self)}
        try:
            own = Material(**said)
        except InputError as error:
            raise InputError(f"pbd:{error}") from None
        heavy = own if self.density is None and self.mass is None else self
        if heavy.density is None and heavy.mass is None:
            heavy = Material(density=physics_material(prim, time_codes).density or DENSITY)
        stiff = own if self.youngs_modulus is None and self.bending is None else self
        return replace(
            self,
            pin=self.pin or own.pin or "root",
            density=heavy.density,
            mass=heavy.mass,
            compliance=next(value for value in (self.compliance, own.compliance, 0.0) if value is not None),
            youngs_modulus=stiff.youngs_modulus,
            bending=stiff.bending,
            rest_shape=self.rest_shape or own.rest_shape or "straight",
        )


def camel_case(name: str) -> str:
    """youngs_modulus is youngsModulus in USD."""
    first, *others = name.split("_")
    return first + "".join(word.capitalize() for word in others)
