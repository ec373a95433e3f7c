"""UsdGeom.Plane and Sphere as colliders."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from pbd_warp.curves.material import attribute
from pbd_warp.curves.reading import Placement
from pbd_warp.errors import InputError
from pbd_warp.model.builder import ModelBuilder

AXES = {"X": 0, "Y": 1, "Z": 2}

UNEVEN = 1e-4
"""Relative difference of its scales up to which a sphere is one."""


def add_collider(builder: ModelBuilder, prim: Usd.Prim, time_codes: np.ndarray, origin: np.ndarray) -> None:
    """Add a prim to the model, with friction and restitution from pbd:friction and pbd:restitution.

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
    placement = Placement(prim, time_codes)
    linear, offset = placement.at(float(time_codes[0]))
    moves = any(
        not (np.array_equal(linear, now) and np.array_equal(offset, there))
        for now, there in map(placement.at, map(float, time_codes))
    )
    shape = plane.GetAxisAttr() if plane else sphere.GetRadiusAttr()
    if moves or shape.ValueMightBeTimeVarying():
        raise InputError(f"{path} changes with time, which is not supported for a collider: leave it out of --collide")
    options = {name: attribute(prim, name) or 0.0 for name in ("friction", "restitution")}
    value = shape.Get()
    if value is None or (plane and value not in AXES):
        raise InputError(f"{path} has no {shape.GetName()} that makes it a collider, but {value!r}")
    try:
        if plane:
            # A normal goes the way of areas, which is that of points only without shear and uneven scale.
            normal = np.linalg.inv(linear)[:, AXES[value]]
            builder.add_plane(offset - origin, normal, **options)
        else:
            scales = np.linalg.svd(linear, compute_uv=False)
            if scales[0] - scales[-1] > UNEVEN * scales[0]:
                raise InputError("it is not scaled evenly, so it is no sphere, and not supported as a collider")
            builder.add_sphere(offset - origin, value * scales[0], **options)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
