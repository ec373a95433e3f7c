"""UsdGeom.Plane and Sphere as colliders."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from pbd_warp.curves.attributes import changes, own_setting
from pbd_warp.curves.physics import physics_material
from pbd_warp.curves.placement import Placement
from pbd_warp.errors import InputError
from pbd_warp.model.builder import ModelBuilder

AXES = {"X": 0, "Y": 1, "Z": 2}

UNEVEN = 1e-4
"""Relative difference of its scales up to which a sphere is one."""


def add_collider(builder: ModelBuilder, prim: Usd.Prim, time_codes: np.ndarray, origin: np.ndarray) -> None:
    """Add a prim to the model, with friction and restitution from pbd:friction and pbd:restitution, or else from its
    physics material.

    A Plane goes on beyond its width and length; curves stay on the side of its axis.

    Args:
        origin: Of the simulation in world space [m].

    Raises:
        InputError: anything that is neither Plane nor Sphere, moves, or is a sphere no more when scaled.
    """
    path = prim.GetPath()
    plane, sphere = UsdGeom.Plane(prim), UsdGeom.Sphere(prim)
    if not (plane or sphere):
        raise InputError(
            f"{path} is a {prim.GetTypeName()}, which is not supported as a collider: give a Plane or a Sphere"
        )
    try:
        placement = Placement(prim, time_codes)
        shape = plane.GetAxisAttr() if plane else sphere.GetRadiusAttr()
        if placement.animated or changes(shape, time_codes):
            raise InputError("it changes with time, which is not supported for a collider: leave it out of --collide")
        linear, offset = placement.at(float(time_codes[0]))
        value = shape.Get(float(time_codes[0]))
        if plane and value not in AXES:
            raise InputError(f"its axis must be X, Y or Z, not {value!r}")
        surface = _surface(prim, time_codes)
        if plane:
            # A normal goes the way of areas, which is that of points only without shear and uneven scale.
            normal = np.linalg.inv(linear)[:, AXES[value]]
            builder.add_plane(offset - origin, normal, **surface)
        else:
            scales = np.linalg.svd(linear, compute_uv=False)
            if scales[0] - scales[-1] > UNEVEN * scales[0]:
                raise InputError("it is not scaled evenly, so it is no sphere, and not supported as a collider")
            builder.add_sphere(offset - origin, value * scales[0], **surface)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _surface(prim: Usd.Prim, time_codes: np.ndarray) -> dict[str, float]:
    """Friction and restitution."""
    own = {name: own_setting(prim, name, time_codes) for name in ("friction", "restitution")}
    bound = physics_material(prim, time_codes)
    return {name: next(v for v in (own[name], getattr(bound, name), 0.0) if v is not None) for name in own}
