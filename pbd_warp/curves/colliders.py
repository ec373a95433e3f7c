"""Geometry of a stage as colliders: at rest, or moved as its transforms say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Usd

from pbd_warp.curves.attributes import own_setting
from pbd_warp.curves.meshes import Solid, solid_of
from pbd_warp.curves.physics import physics_material
from pbd_warp.curves.placement import Placement
from pbd_warp.errors import InputError
from pbd_warp.kernels.shapes import BOX, CAPSULE, CONE, PLANE, SPHERE
from pbd_warp.model.builder import ModelBuilder
from pbd_warp.model.rotation import from_matrix, rotation_vector
from pbd_warp.simulation import Simulation

UNEVEN = 1e-4
"""Relative difference of scales up to which they are the same."""


@dataclass(frozen=True)
class StageCollider:
    """One prim.

    solid: What it is, in its own space. middle: Of it, there. placement: From there to the world [m]. surface: Friction
    and restitution.
    """

    path: str
    solid: Solid
    placement: Placement
    surface: dict[str, float]
    start: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, prim: Usd.Prim, time_codes: np.ndarray) -> StageCollider:
        """Raises an InputError for what is no solid, mesh or plane, or changes its form."""
        path = str(prim.GetPath())
        try:
            solid = solid_of(prim, time_codes)
            placement = Placement(prim, time_codes)
            start = placement.at(float(time_codes[0]))
            collider = cls(path, solid, placement, _surface(prim, time_codes), start)
            for time_code in time_codes if placement.animated else ():
                collider._turn(float(time_code))
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        return collider

    def add(self, builder: ModelBuilder, origin: np.ndarray) -> int:
        """Add it to a model as it is at the first frame; its number there. origin: Of the simulation [m]."""
        try:
            number = self._add(builder, origin)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from None
        if self.placement.animated:
            builder.let_collider_move(number)
        return number

    def place(self, time_code: float) -> tuple[np.ndarray, np.ndarray]:
        """Where its origin is in the world then [m], and how it is turned from how it was added [rad]."""
        linear, offset = self.placement.at(time_code)
        return self.solid.middle @ linear + offset, rotation_vector(from_matrix(self._turn(time_code)))

    def _turn(self, time_code: float) -> np.ndarray:
        """The rotation of row vectors from the first frame until then."""
        turn = np.linalg.solve(self.start[0], self.placement.at(time_code)[0])
        if not np.allclose(turn @ turn.T, np.eye(3), atol=UNEVEN):
            raise InputError(f"its scale changes until time code {time_code:g}, and colliders keep their form")
        u, _, v = np.linalg.svd(turn)
        return u @ v

    def _add(self, builder: ModelBuilder, origin: np.ndarray) -> int:
        solid, (linear, offset) = self.solid, self.start
        place = solid.middle @ linear + offset - origin
        if solid.kind == PLANE:
            # A normal goes the way of areas, which is that of points only without shear and uneven scale.
            return builder.add_plane(place, np.linalg.inv(linear) @ solid.axis, **self.surface)
        scale = np.linalg.norm(linear, axis=1)
        square = np.abs(linear @ linear.T / np.outer(scale, scale) - np.eye(3)).max() < UNEVEN
        along = solid.axis.astype(bool)
        across = scale[~along] if solid.kind != SPHERE else scale
        even = square and np.ptp(across) <= UNEVEN * across.max()
        if solid.kind == BOX and square:
            rows = linear / scale[:, None]
            rows[0] *= np.sign(np.linalg.det(rows))
            turned = rotation_vector(from_matrix(rows))
            return builder.add_box(place, 2.0 * solid.size * scale, turned, **self.surface)
        if solid.kind == SPHERE and even:
            return builder.add_sphere(place, float(solid.size[0] * scale[0]), **self.surface)
        tip = solid.axis @ linear
        stretch = float(np.linalg.norm(tip))
        if solid.kind == CONE and even:
            half, radii = solid.size[2] * tip, solid.size[:2] * across[0]
            return builder.add_cone(place - half, place + half, *radii.tolist(), **self.surface)
        if solid.kind == CAPSULE and even and abs(stretch - across[0]) <= UNEVEN * stretch:
            half = solid.size[1] * tip
            return builder.add_capsule(place - half, place + half, float(solid.size[0] * stretch), **self.surface)
        points, triangles = solid.triangles()
        if np.linalg.det(linear) < 0.0:
            triangles = triangles[:, ::-1]
        return builder.add_mesh((points - solid.middle) @ linear, triangles, place, **self.surface)


class MovingColliders:
    """Those of a stage, and their numbers in its model, as it is simulated."""

    def __init__(self, colliders: Sequence[StageCollider], origin: np.ndarray):
        self._moving = [(number, each) for number, each in enumerate(colliders) if each.placement.animated]
        self._origin = origin

    def advance(self, sim: Simulation, time_code: float) -> None:
        """Send them to where they are at the next frame, which has this time code."""
        for number, collider in self._moving:
            place, turn = collider.place(time_code)
            sim.move_collider(number, place - self._origin, turn)


def _surface(prim: Usd.Prim, time_codes: np.ndarray) -> dict[str, float]:
    """Friction and restitution, from pbd:friction and pbd:restitution, or else from its physics material."""
    own = {name: own_setting(prim, name, time_codes) for name in ("friction", "restitution")}
    bound = physics_material(prim, time_codes)
    return {name: next(v for v in (own[name], getattr(bound, name), 0.0) if v is not None) for name in own}
