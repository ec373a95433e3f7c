"""Ropes: particles in a row, joined by distances, which may resist bending."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.bending import REST_SHAPES, lengths_of, rest_turns
from pbd_warp.model.section import RoundSection


class RopeBuilder:
    """The part of `ModelBuilder` that adds ropes, and resistance to bending."""

    particle_count: int
    _distances: list[tuple[np.ndarray, ...]]
    _bends: list[tuple[np.ndarray, ...]]
    _ropes: list[np.ndarray]

    @abstractmethod
    def add_particles(
        self, positions: ArrayLike, velocity: ArrayLike = (0, 0, 0), mass: ArrayLike = 1.0, radius: ArrayLike = 0.0
    ) -> range: ...

    @abstractmethod
    def add_distances(
        self,
        edges: ArrayLike,
        rest_length: ArrayLike | None = None,
        stiffness: ArrayLike = 1.0,
        compliance: ArrayLike = 0.0,
    ) -> None: ...

    @abstractmethod
    def _positions(self) -> np.ndarray: ...

    def add_rope(
        self,
        positions: ArrayLike,
        mass: ArrayLike | None = None,
        pinned: Sequence[int] = (0,),
        radius: ArrayLike | None = None,
        compliance: ArrayLike | None = None,
        stiffness: ArrayLike = 1.0,
        rest_length: ArrayLike | None = None,
        bending: ArrayLike = 0.0,
        rest_shape: str = "straight",
        section: RoundSection | None = None,
    ) -> range:
        """Add a chain of particles joined by distances, and return their indices.

        Args:
            positions: [m], shape [n, 3], n >= 2.
            mass: Of the whole rope, spread by length: each particle has half of its two links; or one a particle
                [kg]. 1 kg unless given.
            pinned: Which of its particles are fixed; -1 is the last. Two next to each other clamp a rope that resists
                bending: there it keeps its direction, in the middle of the link between them.
            radius: Of its particles [m]; 0 unless given.
            compliance: Of each link [m/N]; 0 unless given.
            stiffness: Of each link, 0..1.
            rest_length: Of each link [m], one for all or one each; as long as it is now unless given.
            bending: Resistance B = E I to bending [N m^2], one for all or one for each particle between the ends; see
                `add_bending`.
            rest_shape: What it resists to be bent from: "straight", or "as_built", as it is now.
            section: A material and a thickness, which give mass, radius, compliance and bending.

        Raises:
            InputError: two points in a row that are the same: a link without length has no direction to act along;
                or a section together with what it gives.
        """
        positions = check.vectors("positions", positions)
        n = len(positions)
        if n < 2:
            raise InputError(f"a rope needs at least 2 particles, not {n}")
        same = np.flatnonzero(np.all(positions[1:] == positions[:-1], axis=1))
        if same.size:
            raise InputError(
                f"points {same[0]} and {same[0] + 1} of a rope are the same: leave one of them out, or add two ropes"
            )
        length = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        if rest_length is not None:
            length = check.spread("rest_length", rest_length, n - 1, low=0.0)
        if section is not None:
            given = {"mass": mass, "radius": radius, "compliance": compliance}
            twice = [name for name, value in given.items() if value is not None]
            twice += ["bending"] if np.any(np.asarray(bending) != 0.0) else []
            if twice:
                raise InputError(f"a rope's section gives its {twice[0]}: leave one of the two out")
            mass, radius, bending = section.mass(length), section.radius, section.bending
            compliance = section.compliance(length)
        masses = spread_mass(1.0 if mass is None else mass, length)
        for p in pinned:
            if not -n <= p < n:
                raise InputError(f"pinned names particle {p} of a graph of {n} (0 to {n - 1}, or -1 for the last)")
            masses[p] = 0.0
        resists = check.spread("bending", bending, n - 2, low=0.0)
        added = self.add_particles(positions, mass=masses, radius=0.0 if radius is None else radius)
        along = np.arange(added.start, added.stop, dtype=np.int32)
        links = np.stack([along[:-1], along[1:]], axis=1)
        self.add_distances(links, length, stiffness, 0.0 if compliance is None else compliance)
        bent = np.flatnonzero(resists > 0.0)
        triples = np.stack([along[:-2], along[1:-1], along[2:]], axis=1)[bent]
        self.add_bendings(triples, resists[bent], rest_shape)
        self._ropes.append(along)
        return added

    def add_bending(self, i: int, j: int, k: int, bending: float, rest_shape: str = "straight") -> None:
        """Let three neighbours, of which distances join i to j and j to k, resist being bent at j.

        There is no twist: bending is the turn between two links, in whatever plane it lies. E = B |kb|^2 / (2 l), with
        |kb| = 2 tan(turn / 2) and l half the sum of both rest lengths (kernels/bending.py).

        Args:
            bending: B = E I [N m^2], above 0.
            rest_shape: "straight", or "as_built": the turn that the three have now, to whatever side.

        Raises:
            InputError: no distance joins two of them, one is named twice, or as_built they fold back on each other.
        """
        self.add_bendings([(i, j, k)], bending, rest_shape)

    def add_bendings(self, triples: ArrayLike, bending: ArrayLike, rest_shape: str = "straight") -> None:
        """Let many triples resist being bent, shape [m, 3]; bending one for all or one each. As `add_bending`."""
        if rest_shape not in REST_SHAPES:
            raise unknown("rest_shape", rest_shape, REST_SHAPES)
        triple = check.indices("bending", triples, self.particle_count)
        if triple.size == 0:
            return
        if triple.ndim != 2 or triple.shape[1] != 3:
            raise InputError(f"triples must have shape [m, 3], not {list(triple.shape)}")
        stiffness = check.spread("bending", bending, len(triple), low=0.0)
        none = np.flatnonzero(stiffness == 0.0)
        if none.size:
            raise InputError(f"bending at particle {triple[none[0], 1]} must be above 0: leave it out")
        edges = np.concatenate([np.zeros((0, 2), np.int32), *(edge for edge, *_ in self._distances)])
        rest = np.concatenate([np.zeros(0), *(each for _, each, *_ in self._distances)])
        length = lengths_of(triple, edges, rest)
        self._bends.append((triple, stiffness, length, rest_turns(self._positions(), triple, rest_shape)))


def spread_mass(mass: ArrayLike, length: np.ndarray) -> np.ndarray:
    """Masses of a rope's particles [kg], float64 [link_count + 1]: half of both links' share of the whole, by length;
    or as given one by one."""
    masses = check.spread("mass", mass, len(length) + 1, low=0.0)
    if np.ndim(mass) == 0 and length.sum() > 0.0:
        share = np.concatenate([length, [0.0]]) + np.concatenate([[0.0], length])
        masses = masses * (share / share.sum())
    elif np.ndim(mass) == 0:
        masses = masses / len(masses)
    return masses
