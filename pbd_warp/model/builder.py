"""Builds models: particles, constraints, colliders. Every value is checked when it is added."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from pbd_warp import check, kernel_cache
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.bending import BendingSet
from pbd_warp.model.colliders import ColliderBuilder
from pbd_warp.model.constraints import DistanceSet, PointSet, check_capsules, check_softness
from pbd_warp.model.copies import check_varying, replicate
from pbd_warp.model.graph import components
from pbd_warp.model.model import Contacts, Model
from pbd_warp.model.rope import RopeBuilder

DTYPES = {"float32": wp.float32, "float64": wp.float64}


class ModelBuilder(RopeBuilder, ColliderBuilder):
    """Collects particles, constraints and colliders; `finalize` makes a Model of them.

    SI units, y up. All methods raise InputError on input that makes no sense (not finite, negative mass, radius or
    compliance, stiffness outside 0..1, an index that is no particle), and name it.

    Args:
        gravity: Acceleration of all free particles [m/s^2].
    """

    def __init__(self, gravity: ArrayLike = (0.0, -9.81, 0.0)):
        super().__init__()
        self.gravity = check.vector("gravity", gravity)
        self.particle_count = 0
        self._particles: list[tuple[np.ndarray, ...]] = []  # x, v, w, radius
        self._distances: list[tuple[np.ndarray, ...]] = []  # edge, rest_length, stiffness, compliance
        self._points: list[tuple[np.ndarray, ...]] = []  # particle, target, stiffness, compliance
        self._bends: list[tuple[np.ndarray, ...]] = []  # triple, stiffness, length, rest
        self._ropes: list[np.ndarray] = []
        self._contacts: Contacts | None = None
        self._copies: tuple[int, dict[str, ArrayLike]] | None = None

    def __repr__(self) -> str:
        counts = {"particles": self._particles, "distances": self._distances, "points": self._points}
        each = {name: sum(len(rows[0]) for rows in chunks) for name, chunks in counts.items()}
        each |= {"bends": sum(len(rows[0]) for rows in self._bends), "colliders": len(self._colliders)}
        return f"ModelBuilder({', '.join(f'{count} {name}' for name, count in each.items() if count) or 'empty'})"

    def add_particle(
        self, position: ArrayLike, velocity: ArrayLike = (0, 0, 0), mass: float = 1.0, radius: float = 0.0
    ) -> int:
        """Add one particle and return its index. Mass 0 [kg] means fixed."""
        return self.add_particles([check.vector("position", position)], velocity, mass, radius)[0]

    def add_particles(
        self, positions: ArrayLike, velocity: ArrayLike = (0, 0, 0), mass: ArrayLike = 1.0, radius: ArrayLike = 0.0
    ) -> range:
        """Add particles and return the range of their indices.

        Args:
            positions: [m], shape [n, 3].
            velocity: [m/s], one for all or one each, shape [n, 3].
            mass: [kg], one for all or one each; 0 means fixed.
            radius: [m], one for all or one each.
        """
        x = check.vectors("positions", positions)
        n = len(x)
        v = np.asarray(velocity, dtype=np.float64)
        v = check.vectors("velocity", np.broadcast_to(v, (n, 3)) if v.ndim == 1 else v)
        if len(v) != n:
            raise InputError(f"velocity must be one vector or {n} of them, not {len(v)}")
        mass = check.spread("mass", mass, n, low=0.0)
        moving = np.flatnonzero((mass == 0.0) & np.any(v != 0.0, axis=1))
        if moving.size:
            raise InputError(f"particle {self.particle_count + moving[0]} is fixed (mass 0), so its velocity must be 0")
        w = np.divide(1.0, mass, out=np.zeros(n), where=mass > 0.0)
        self._particles.append((x, v, w, check.spread("radius", radius, n, low=0.0)))
        first, self.particle_count = self.particle_count, self.particle_count + n
        return range(first, self.particle_count)

    def add_distance(
        self, i: int, j: int, rest_length: float | None = None, stiffness: float = 1.0, compliance: float = 0.0
    ) -> None:
        """Hold two particles at a distance [m]; None: the one they have now. compliance in m/N."""
        self.add_distances([(i, j)], rest_length, stiffness, compliance)

    def add_distances(
        self,
        edges: ArrayLike,
        rest_length: ArrayLike | None = None,
        stiffness: ArrayLike = 1.0,
        compliance: ArrayLike = 0.0,
    ) -> None:
        """Hold many pairs, shape [m, 2]; the other values one for all or one each."""
        edge = check.indices("edge", edges, self.particle_count)
        if edge.size == 0:
            return
        if edge.ndim != 2 or edge.shape[1] != 2:
            raise InputError(f"edges must have shape [m, 2], not {list(edge.shape)}")
        loop = np.flatnonzero(edge[:, 0] == edge[:, 1])
        if loop.size:
            raise InputError(
                f"edge {loop[0]} joins particle {edge[loop[0], 0]} to itself: it needs two different particles"
            )
        m = len(edge)
        if rest_length is None:
            x = self._positions()
            rest_length = np.linalg.norm(x[edge[:, 0]] - x[edge[:, 1]], axis=1)
        rest = check.spread("rest_length", rest_length, m, low=0.0)
        self._distances.append((edge, rest, *self._softness("a distance", stiffness, compliance, m)))

    def add_point(
        self, i: int, target: ArrayLike | None = None, stiffness: float = 1.0, compliance: float = 0.0
    ) -> None:
        """Lock a particle to a coordinate [m]; None: where it is now. compliance in m/N."""
        particle = check.indices("point", [i], self.particle_count)
        target = self._positions()[particle] if target is None else check.vectors("target", [target])
        self._points.append((particle, target, *self._softness("a point", stiffness, compliance, 1)))

    def add_graph(
        self,
        positions: ArrayLike,
        edges: ArrayLike,
        mass: ArrayLike = 1.0,
        pinned: Sequence[int] = (),
        radius: ArrayLike = 0.0,
        compliance: ArrayLike = 0.0,
        stiffness: ArrayLike = 1.0,
    ) -> range:
        """Add any graph of particles, joined by distances as long as they are now, and return their indices.

        Args:
            positions: [m], shape [n, 3].
            edges: Pairs of indices into `positions`, shape [m, 2].
            mass: Of the whole graph, or one a particle [kg].
            pinned: Which of its particles are fixed; -1 is the last.
            radius, compliance [m/N], stiffness 0..1: as for a rope.
        """
        x = check.vectors("positions", positions)
        n = len(x)
        masses = check.spread("mass", mass, n, low=0.0)
        if np.ndim(mass) == 0:
            masses = masses / max(n, 1)
        for p in pinned:
            if not -n <= p < n:
                raise InputError(f"pinned names particle {p} of a graph of {n} (0 to {n - 1}, or -1 for the last)")
            masses[p] = 0.0
        edge = check.indices("edges", edges, n)
        added = self.add_particles(x, mass=masses, radius=radius)
        self.add_distances(edge + np.int32(added.start), stiffness=stiffness, compliance=compliance)
        return added

    def enable_contacts(self, friction: float = 0.0, restitution: float = 0.0, links: bool = False) -> None:
        """Let what has a radius collide with each other: particles, except those that a distance joins, or links.

        Args:
            friction: Coulomb's coefficient, >= 0.
            restitution: 0 (no bounce) to 1.
            links: Every distance is a capsule, as thick as its particles, and keeps off all others, from particles
                without a distance, and from colliders; neighbours along a rope, nearer than half a turn of it, are
                left out. Found over the whole step, so a thin fast rope does not tunnel.
        """
        self._contacts = Contacts(
            check.number("friction", friction, low=0.0),
            check.number("restitution", restitution, low=0.0, high=1.0),
            bool(links),
        )

    def replicate(self, n: int, **varying: ArrayLike) -> ModelBuilder:
        """A builder of n copies of what is in this one: many small simulations in one, which do not meet each other.

        Args:
            n: How many.
            **varying: What differs from copy to copy: positions [m], velocity [n, particle_count, 3]; mass [kg] (of
                what is not fixed), radius [n, particle_count]; rest_length [m], stiffness, compliance [m/N]
                [n, edge_count]. [n, 1] stands for one value a copy.
        """
        copies, edges = copy(self), sum(len(rows[0]) for rows in self._distances)
        check_varying(check.whole("copies", n, low=1), self.particle_count, edges, varying)
        copies._copies = n, varying
        vars(copies).update({name: list(value) for name, value in vars(self).items() if isinstance(value, list)})
        return copies

    def finalize(self, device: str | wp.Device | None = None, dtype: str = "float32") -> Model:
        """Make a Model.

        Args:
            device: Name of a Warp device; None for Warp's preferred one.
            dtype: "float32" or "float64".
        """
        if dtype not in DTYPES:
            raise unknown("dtype", dtype, DTYPES)
        if self.particle_count == 0:
            raise InputError("the model has no particles: add some with add_particle, add_rope or add_graph")
        x, v, w, radius = _columns(self._particles, _VECTOR, _VECTOR, _SCALAR, _SCALAR)
        with np.errstate(over="ignore"):
            too_large = np.flatnonzero(~np.isfinite(np.concatenate([x, v], axis=1).astype(dtype)).all(axis=1))
        if too_large.size:
            raise InputError(f"particle {too_large[0]} is too large or fast a number for {dtype}: use dtype 'float64'")
        if self._contacts and not np.any(radius > 0.0):
            raise InputError("contacts are enabled but every radius is 0: give the particles a radius")
        distance = DistanceSet(*_columns(self._distances, _INDEX_PAIR, _SCALAR, _SCALAR, _SCALAR))
        if self._contacts and self._contacts.links:
            check_capsules(distance, radius)
        model = Model(
            gravity=self.gravity,
            x=x,
            v=v,
            w=w,
            radius=radius,
            distance=distance,
            point=PointSet(*_columns(self._points, _INDEX, _VECTOR, _SCALAR, _SCALAR)),
            bending=BendingSet(*_columns(self._bends, _INDEX_TRIPLE, _SCALAR, _SCALAR, _SCALAR)),
            contacts=self._contacts,
            colliders=self._finished_colliders(radius, w),
            ropes=tuple(self._ropes),
            component=components(distance.edge, self.particle_count),
            device=find_device(device),
            real=DTYPES[dtype],
        )
        return replicate(model, *self._copies) if self._copies else model

    def _positions(self) -> np.ndarray:
        return np.concatenate([x for x, *_ in self._particles])

    def _softness(
        self, what: str, stiffness: ArrayLike, compliance: ArrayLike, n: int
    ) -> tuple[np.ndarray, np.ndarray]:
        k = check.spread("stiffness", stiffness, n, low=0.0, high=1.0)
        a = check.spread("compliance", compliance, n, low=0.0)
        check_softness(what, k, a)
        return k, a


_INDEX, _INDEX_PAIR = np.zeros(0, np.int32), np.zeros((0, 2), np.int32)
_INDEX_TRIPLE = np.zeros((0, 3), np.int32)
_SCALAR, _VECTOR = np.zeros(0), np.zeros((0, 3))


def _columns(rows: list[tuple[np.ndarray, ...]], *empty: np.ndarray) -> list[np.ndarray]:
    """The columns of chunks of rows, each below its `empty` one, which says what it looks like without any."""
    return [np.concatenate(column) for column in zip(empty, *rows, strict=True)]


def find_device(device: str | wp.Device | None) -> wp.Device:
    """The Warp device of that name, or an InputError that lists those there are."""
    kernel_cache.begin()
    if device is None:
        return wp.get_preferred_device()
    names = [d.alias for d in wp.get_devices()]
    if str(device) not in names:
        raise unknown("device", device, names)
    return wp.get_device(device)
