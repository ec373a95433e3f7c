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
        plain: Of planes and spheres at rest, on the device: number, kind, centre, normal, radius; none: empty.
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
        self.plain: tuple[wp.array, ...] = ()
        self.shapes = np.flatnonzero(~plain)
        self.moving = bool(np.any(c.moves))
        self._start: tuple[wp.array, ...] = ()
        self._state: tuple[wp.array, ...] = ()
        if plain.any():
            some = np.flatnonzero(plain)
            self.plain = (
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
            self._state = (self.centre, self.rotation, self.velocity, self.spin)

    def find(self, margin: float, depenetration: float, radius: wp.array, found: tuple[Any, ...]) -> None:
        """Line 8. found: count, pair, normal, gap, carried and valence of `ContactConstraints`."""
        context = self._context
        n = context.model.particle_count
        count, pair, normal, gap, carried, valence = found
        state = (context.state.x, context.w, context.u)
        if self.plain:
            context.launch(
                find_collider_contacts,
                n,
                *(*self.plain, radius, margin, depenetration, *state),
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

    def stop(self, which: int) -> None:
        """A collider that moves rests."""
        one = int(np.flatnonzero(self.shapes == which)[0])
        self.velocity[one : one + 1].zero_()
        self.spin[one : one + 1].zero_()

    def reset(self) -> None:
        """Back to where they were at the start, and to how they moved."""
        c = self._context.model.colliders
        if self.moving:
            for array, values in zip(self._state, (c.centre, c.rotation, c.velocity, c.spin), strict=True):
                array.assign(values[self.shapes])

    def keep_start(self) -> None:
        """Keep from now on where they are at the start of a frame, so that it can be made again."""
        if self.moving:
            allocate, n = self._context.allocate, len(self.shapes)
            self._start = (
                allocate("start.shape_centre", n, self._context.vec3),
                allocate("start.shape_rotation", n, self._context.quat),
            )

    def begin_frame(self) -> None:
        for kept, array in zip(self._start, self._state, strict=False):
            self._context.launch.copy(kept, array)

    def take_over(self, other: ColliderShapes, start: bool) -> None:
        """Go on from where the same ones of another simulation are, or were at the start of its frame."""
        if self.moving:
            theirs = (*other._start, *other._state[2:]) if start else other._state
            for mine, array in zip(self._state, theirs, strict=True):
                wp.copy(mine, array)

    def motion(self) -> np.ndarray:
        """All that changes of shapes: origin, quaternion, velocity and spin, [shape_count, 13]; none if none move."""
        if not self.moving:
            return np.zeros((0, 13))
        return np.concatenate([array.numpy() for array in self._state], axis=1)

    def put(self, motion: np.ndarray) -> None:
        """To what `motion` was."""
        if self.moving:
            for array, values in zip(self._state, np.split(motion, (3, 7, 10), axis=1), strict=True):
                array.assign(np.ascontiguousarray(values))

    def places(self) -> tuple[np.ndarray, np.ndarray]:
        """Where all colliders are now: their origins [m], float64 [collider_count, 3], and quaternions (x, y, z, w)."""
        c = self._context.model.colliders
        centre, rotation = c.centre.copy(), c.rotation.copy()
        if self.moving:
            centre[self.shapes], rotation[self.shapes] = self.centre.numpy(), self.rotation.numpy()
        return centre, rotation

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
