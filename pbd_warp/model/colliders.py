"""What particles and links stay outside of: at rest, or moved as it is told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.kernels.shapes import BOX, CAPSULE, CONE, MESH, PLANE, SPHERE
from pbd_warp.model.meshes import checked_mesh, is_closed
from pbd_warp.model.rotation import STILL, from_y, quaternion

_NO_POINTS, _NO_TRIANGLES = np.zeros((0, 3)), np.zeros((0, 3), np.int32)

NAMES = {PLANE: "plane", SPHERE: "sphere", BOX: "box", CAPSULE: "capsule", CONE: "cone", MESH: "mesh"}
"""Of each kind; a cylinder is a cone whose ends are equal."""


@dataclass(frozen=True)
class Colliders:
    """NumPy arrays, one row a collider, [collider_count] or [collider_count, 3]; those of meshes all in one.

    kind: Of kernels/shapes. centre [m], rotation: The frame in which it lies at the start; quaternions (x, y, z, w),
    [collider_count, 4]. size: What its file in kernels/shapes says. friction, restitution. moves: 1 where it may move,
    with velocity [m/s] and spin [rad/s] unless it is moved otherwise.
    points [m], [n, 3], triangles [m, 3]: of all meshes, in their frames; those of one count from its first point.
    point_count, triangle_count: how many are each collider's.
    """

    kind: np.ndarray
    centre: np.ndarray
    rotation: np.ndarray
    size: np.ndarray
    friction: np.ndarray
    restitution: np.ndarray
    moves: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    points: np.ndarray
    triangles: np.ndarray
    point_count: np.ndarray
    triangle_count: np.ndarray

    def __len__(self) -> int:
        return len(self.kind)

    def mesh(self, which: int) -> tuple[np.ndarray, np.ndarray]:
        """Points [m] and triangles of a collider that is a mesh, in its frame."""
        p, t = self.point_count[:which].sum(), self.triangle_count[:which].sum()
        return self.points[p : p + self.point_count[which]], self.triangles[t : t + self.triangle_count[which]]

    def overlaps_at_rest(self, x: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How deep particles at x [m] are in the plane or sphere at rest in which they are deepest [m], 0: in none, and
        its number; shapes [particle_count]."""
        depth, deepest = np.zeros(len(x)), np.zeros(len(x), int)
        for which in np.flatnonzero((self.kind <= SPHERE) & (self.moves == 0)):
            away = x - self.centre[which]
            ball = self.kind[which] == SPHERE
            surface = np.linalg.norm(away, axis=1) - self.size[which, 0] if ball else away @ self.size[which]
            deeper = radius - surface > depth
            depth[deeper], deepest[deeper] = (radius - surface)[deeper], which
        return depth, deepest

    def title(self, which: int) -> str:
        """What it is, as the name of a prim."""
        cylinder = self.kind[which] == CONE and self.size[which, 0] == self.size[which, 1]
        return "Cylinder" if cylinder else NAMES[int(self.kind[which])].title()

    def name(self, which: int) -> str:
        """For a message."""
        return f"collider {which} (a {NAMES[int(self.kind[which])]})"


class ColliderBuilder:
    """The part of `ModelBuilder` that adds colliders. Each method gives the collider's number.

    friction: Coulomb's coefficient, >= 0. restitution: 0 (no bounce) to 1. rotation: Axis times angle [rad].
    """

    def __init__(self) -> None:
        self._colliders: list[dict[str, np.ndarray]] = []

    def add_plane(self, point: ArrayLike, normal: ArrayLike, friction: float = 0.0, restitution: float = 0.0) -> int:
        """Add a plane through `point` [m]; particles stay on the side that `normal` points to."""
        n = check.vector("normal", normal)
        length = np.linalg.norm(n)
        if length == 0.0:
            raise InputError("normal must not be (0, 0, 0): it says which side of the plane is free")
        return self._add_collider(PLANE, check.vector("point", point), n / length, friction, restitution)

    def add_sphere(self, centre: ArrayLike, radius: float, friction: float = 0.0, restitution: float = 0.0) -> int:
        """Add a sphere [m]; particles stay outside."""
        size = (check.number("radius", radius, above=0.0), 0.0, 0.0)
        return self._add_collider(SPHERE, check.vector("centre", centre), size, friction, restitution)

    def add_box(
        self,
        centre: ArrayLike,
        size: ArrayLike,
        rotation: ArrayLike = (0, 0, 0),
        friction: float = 0.0,
        restitution: float = 0.0,
    ) -> int:
        """Add a box. size: The lengths of its edges [m], [3]."""
        edges = check.vector("size", size)
        if np.any(edges <= 0.0):
            raise InputError(f"size must be three lengths above 0, not {edges.tolist()}")
        turned = quaternion(check.vector("rotation", rotation))
        return self._add_collider(BOX, check.vector("centre", centre), 0.5 * edges, friction, restitution, turned)

    def add_capsule(
        self, start: ArrayLike, end: ArrayLike, radius: float, friction: float = 0.0, restitution: float = 0.0
    ) -> int:
        """Add all that is nearer than `radius` [m] to the line between two points [m]."""
        centre, half, turned = _axis(start, end)
        size = (check.number("radius", radius, above=0.0), half, 0.0)
        return self._add_collider(CAPSULE, centre, size, friction, restitution, turned)

    def add_cylinder(
        self, start: ArrayLike, end: ArrayLike, radius: float, friction: float = 0.0, restitution: float = 0.0
    ) -> int:
        """Add a cylinder with flat ends around the line between two points [m]."""
        return self.add_cone(start, end, radius, radius, friction, restitution)

    def add_cone(
        self,
        start: ArrayLike,
        end: ArrayLike,
        start_radius: float,
        end_radius: float = 0.0,
        friction: float = 0.0,
        restitution: float = 0.0,
    ) -> int:
        """Add a cone around the line between two points [m], with flat ends of these radii [m]."""
        centre, half, turned = _axis(start, end)
        radii = [check.number("radius", radius, low=0.0) for radius in (start_radius, end_radius)]
        if max(radii) == 0.0:
            raise InputError("one of a cone's radii must be above 0")
        return self._add_collider(CONE, centre, (*radii, half), friction, restitution, turned)

    def add_mesh(
        self,
        points: ArrayLike,
        triangles: ArrayLike,
        position: ArrayLike = (0, 0, 0),
        rotation: ArrayLike = (0, 0, 0),
        friction: float = 0.0,
        restitution: float = 0.0,
    ) -> int:
        """Add a triangle mesh. Where each edge joins two triangles it is solid, and free on the side from which they
        are seen counterclockwise; otherwise it is a sheet, which holds on both its sides.

        Args:
            points: [m], shape [n, 3], best around the origin: position and rotation put it where it is. Nearest
                triangles are sought in float32.
            triangles: Indices of points, shape [m, 3]; those without an area do not count.
        """
        x, face = checked_mesh(points, triangles)
        turned, place = quaternion(check.vector("rotation", rotation)), check.vector("position", position)
        size = (float(is_closed(x, face)), 0.5 * float(np.ptp(x, axis=0).min()), float(np.linalg.norm(x, axis=1).max()))
        return self._add_collider(MESH, place, size, friction, restitution, turned, x, face)

    def let_collider_move(
        self, which: int, velocity: ArrayLike = (0, 0, 0), angular_velocity: ArrayLike = (0, 0, 0)
    ) -> None:
        """Let a collider move: with these velocities [m/s], [rad/s], until `Simulation.move_collider` moves it."""
        row = self._colliders[check.index("collider", which, len(self._colliders))]
        row["moves"] = np.int32(1)
        row["velocity"], row["spin"] = (
            check.vector("velocity", velocity),
            check.vector("angular_velocity", angular_velocity),
        )

    def _add_collider(
        self,
        kind: int,
        centre: np.ndarray,
        size: ArrayLike,
        friction: float,
        restitution: float,
        rotation: np.ndarray = STILL,
        points: np.ndarray = _NO_POINTS,
        triangles: np.ndarray = _NO_TRIANGLES,
    ) -> int:
        self._colliders.append(
            {
                "kind": np.int32(kind),
                "centre": centre,
                "rotation": rotation,
                "size": np.asarray(size, np.float64),
                "friction": np.float64(check.number("friction", friction, low=0.0)),
                "restitution": np.float64(check.number("restitution", restitution, low=0.0, high=1.0)),
                "moves": np.int32(0),
                "velocity": np.zeros(3),
                "spin": np.zeros(3),
                "points": points,
                "triangles": triangles,
                "point_count": np.int32(len(points)),
                "triangle_count": np.int32(len(triangles)),
            }
        )
        return len(self._colliders) - 1

    def _finished_colliders(self, radius: np.ndarray, w: np.ndarray) -> Colliders:
        """All of them, for particles of these radii and inverse masses."""
        rows = self._colliders
        thin = np.flatnonzero((radius == 0.0) & (w > 0.0))
        if thin.size and any(row["kind"] == MESH and row["size"][0] == 0.0 for row in rows):
            raise InputError(
                f"particle {thin[0]} has no radius, without which an open mesh cannot keep it on one side: give it "
                "one, or close the mesh"
            )
        columns: dict[str, np.ndarray] = {
            name: np.array([row[name] for row in rows], kind).reshape(len(rows), *shape)
            for name, (kind, shape) in _COLUMNS.items()
        }
        points = np.concatenate([_NO_POINTS, *(row["points"] for row in rows)])
        triangles = np.concatenate([_NO_TRIANGLES, *(row["triangles"] for row in rows)])
        return Colliders(**columns, points=points, triangles=triangles)


_COLUMNS: dict[str, tuple[type, tuple[int, ...]]] = {
    **dict.fromkeys(("kind", "moves", "point_count", "triangle_count"), (np.int32, ())),
    **dict.fromkeys(("friction", "restitution"), (np.float64, ())),
    **dict.fromkeys(("centre", "size", "velocity", "spin"), (np.float64, (3,))),
    "rotation": (np.float64, (4,)),
}
"""Type of each column that has a row a collider, and its shape."""


def _axis(start: ArrayLike, end: ArrayLike) -> tuple[np.ndarray, float, np.ndarray]:
    """The middle of two points, half their distance, and the turn from y to the line between them."""
    a, b = check.vector("start", start), check.vector("end", end)
    length = float(np.linalg.norm(b - a))
    if length == 0.0:
        raise InputError(f"start and end are the same point, {a.tolist()}: they must be two")
    return 0.5 * (a + b), 0.5 * length, from_y((b - a) / length)
