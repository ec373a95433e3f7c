"""What a stage says in terms of UsdPhysics: gravity, and the materials bound to its prims. All of it in SI units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

from pbd_warp import check
from pbd_warp.curves.attributes import constant
from pbd_warp.errors import InputError

EARTH = 9.81
"""Gravity where nobody says otherwise [m/s^2]."""


@dataclass(frozen=True)
class PhysicsMaterial:
    """What a prim's bound physics material says. None: nothing.

    density [kg/m^3]; friction: Coulomb's coefficient in motion; restitution: 0..1.
    """

    density: float | None = None
    friction: float | None = None
    restitution: float | None = None


def physics_material(prim: Usd.Prim, time_codes: np.ndarray) -> PhysicsMaterial:
    """Of a prim: bound to it, above it or through a collection; a density of its own (MassAPI) goes before.

    Raises:
        InputError: one of the values changes with time.
    """
    stage = prim.GetStage()
    metres, kilograms = UsdGeom.GetStageMetersPerUnit(stage), UsdPhysics.GetStageKilogramsPerUnit(stage)
    own = constant(UsdPhysics.MassAPI(prim).GetDensityAttr(), time_codes)
    bound, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    if not bound or not bound.GetPrim().HasAPI(UsdPhysics.MaterialAPI):
        return PhysicsMaterial(_positive(own, kilograms / metres**3))
    material = UsdPhysics.MaterialAPI(bound)
    try:
        return PhysicsMaterial(
            _positive(own or constant(material.GetDensityAttr(), time_codes), kilograms / metres**3),
            constant(material.GetDynamicFrictionAttr(), time_codes),
            constant(material.GetRestitutionAttr(), time_codes),
        )
    except InputError as error:
        raise InputError(f"its physics material {bound.GetPath()}: {error}") from None


def _positive(value: float | None, unit: float) -> float | None:
    """0 is UsdPhysics' way to say nothing."""
    return value * unit if value else None


def up_axis(stage: Usd.Stage) -> np.ndarray:
    """The stage's up axis, shape [3].

    Raises:
        InputError: it is neither Y nor Z.
    """
    axis = UsdGeom.GetStageUpAxis(stage)
    if axis not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        raise InputError(f"{stage.GetRootLayer().GetDisplayName()}: upAxis must be Y or Z, not {axis!r}")
    return np.eye(3)["XYZ".index(axis)]


def gravity_of(stage: Usd.Stage, time_codes: np.ndarray) -> tuple[np.ndarray, str]:
    """Gravity [m/s^2], shape [3], of the stage's physics scene (the earth's without one), and what there is to note.

    Raises:
        InputError: it changes with time, or is not finite.
    """
    down = -up_axis(stage)
    scenes = [UsdPhysics.Scene(prim) for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)]
    if not scenes:
        return EARTH * down, ""
    found = []
    for scene in scenes:
        try:
            direction = constant(scene.GetGravityDirectionAttr(), time_codes)
            magnitude = constant(scene.GetGravityMagnitudeAttr(), time_codes)
            way = check.vector("gravityDirection", direction)
            length = np.linalg.norm(way)
            # UsdPhysics: no direction is down, a negative magnitude the earth's gravity.
            way = way / length if length > 0.0 else down
            size = EARTH if magnitude < 0.0 else magnitude * UsdGeom.GetStageMetersPerUnit(stage)
            found.append(check.number("gravityMagnitude", size) * way)
        except InputError as error:
            raise InputError(f"{scene.GetPath()}: {error}") from None
    differ = any(not np.allclose(found[0], other) for other in found[1:])
    first = scenes[0].GetPath()
    return found[0], f"the stage has several physics scenes; gravity is that of {first}" if differ else ""
