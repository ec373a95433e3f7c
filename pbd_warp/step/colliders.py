"""Colliders on a device: where they are, how they move, and contacts with them. The maths is in kernels/collider.py,
kernels/shape_contact.py and kernels/shapes/."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from pbd_warp.kernels.collider import find_collider_contacts
from pbd_warp.kernels.shape_contact import find_overlaps, find_shape_contacts, move_shapes
from pbd_warp.kernels.shapes import MESH, PLANE, SPHERE
from pbd_warp.step.context import Context


class ColliderShapes:
    """The colliders of one simulation.

    Planes and spheres at rest are looked at by a pass of their own, which does not know of anything else; all others
    are `shapes`, seen from the frame in which each lies.

    Attributes:
        friction, restitution: Of each collider, on the device.
        shapes: Their numbers, int [shape_count].
        moving: Whether any may move.
    """

    def __init__(self, context: Context):
        self._context = context
        c = context.model.colliders
        upload = context.upload
        self.friction = upload("collider.friction", c.friction)
        self.restitution = upload("collider.restitution", c.restitution)
        plain = (c.kind <= SPHERE) & (c.moves == 0)
        self._plain = np.flatnonzero(plain)
        self.shapes = np.flatnonzero(~plain)
        self.moving = bool(np.any(c.moves))
        if len(self._plain):
            some = self._plain
            self._plain_arrays = (
                upload("collider.number", some, wp.int32),
                upload("collider.kind", c.kind[some], wp.int32),
                upload("collider.centre", c.centre[some], context.vec3),
                upload("collider.normal", c.size[some], context.vec3),
                upload("collider.radius", c.size[some, 0]),
            )
        if len(self.shapes):
            some = self.shapes
            self._meshes = [self._mesh(which) if c.kind[which] == MESH else None for which in some.tolist()]
            ids = [mesh.id if mesh else 0 for mesh in self._meshes]
            self._number = upload("shape.number", some, wp.int32)
            self._forms = (
                upload("shape.kind", c.kind[some], wp.int32),
                upload("shape.size", c.size[some], context.vec3),
                wp.array(np.array(ids, np.uint64), dtype=wp.uint64, device=context.model.device),
            )
            self.centre = upload("shape.centre", c.centre[some], context.vec3)
            self.rotation = upload("shape.rotation", c.rotation[some], context.quat)
            self.velocity = upload("shape.velocity", c.velocity[some], context.vec3)
            self.spin = upload("shape.spin", c.spin[some], context.vec3)

    def find(self, margin: float, depenetration: float, radius: wp.array, found: tuple[Any, ...]) -> None:
        """Line 8. found: count, pair, normal, gap, carried and valence of `ContactConstraints`."""
        context = self._context
        n = context.model.particle_count
        count, pair, normal, gap, carried, valence = found
        state = (context.state.x, context.w, context.u)
        if len(self._plain):
            context.launch(
                find_collider_contacts,
                n,
                *(*self._plain_arrays, radius, margin, depenetration, *state),
                *(count, pair, normal, gap, valence),
            )
        if len(self.shapes):
            context.launch(
                find_shape_contacts,
                n,
                *(self._number, *self._forms, radius, margin, depenetration, context.dt),
                *(self.centre, self.rotation, self.velocity, self.spin, *state),
                *(count, pair, normal, gap, carried, valence),
            )

    def advance(self) -> None:
        """To where they are at the end of the step."""
        if self.moving:
            context = self._context
            moved = (self.velocity, self.spin, self.centre, self.rotation)
            context.launch(move_shapes, len(self.shapes), context.dt, *moved)

    def flat_or_round(self) -> tuple[wp.array, wp.array]:
        """Kind and centre of all colliders for `Direct`: what moves, or has another shape, is flat during a step."""
        c, upload = self._context.model.colliders, self._context.upload
        kind = np.where(c.moves == 0, np.minimum(c.kind, SPHERE) * (c.kind <= SPHERE), PLANE)
        return upload("direct.collider_kind", kind, wp.int32), upload(
            "direct.collider_centre", c.centre, self._context.vec3
        )

    def overlaps(self, radius: wp.array, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """How deep each particle is now in the shape in which it is deepest [m], 0: in none, and the number of that
        collider; float64 and int [particle_count]. Planes and spheres at rest are left out."""
        context, n = self._context, self._context.model.particle_count
        if not len(self.shapes):
            return np.zeros(n), np.zeros(n, int)
        device = context.model.device
        depth = wp.zeros(n, dtype=context.real, device=device)
        which = wp.zeros(n, dtype=wp.int32, device=device)
        where = (self.centre, self.rotation, context.state.x)
        context.launch(find_overlaps, n, *(*self._forms, radius, reach), *where, depth, which)
        return depth.numpy().astype(np.float64), self.shapes[which.numpy()]

    def _mesh(self, which: int) -> wp.Mesh:
        """With its points and triangles on the device, in float32 whatever the precision."""
        device = self._context.model.device
        points, triangles = self._context.model.colliders.mesh(which)
        return wp.Mesh(
            points=wp.array(points.astype(np.float32), dtype=wp.vec3, device=device),
            indices=wp.array(triangles.ravel(), dtype=wp.int32, device=device),
        )
