"""Resistance to bending as a model holds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd_warp.errors import InputError

REST_SHAPES = ("straight", "as_built")

FOLDED = 1e-3
"""1 + cos(turn) below which two links count as folded back on each other, where kb is not defined; the same as in
kernels/bending.py."""


@dataclass(frozen=True)
class BendingSet:
    """E = B (|kb| - rest)^2 / (2 l) of three neighbours, with |kb| = 2 tan(turn / 2) (kernels/bending.py).

    triple: int32 [bending_count, 3]: i, j, k, of which distances join the first two and the last two. stiffness: B
    [N m^2], above 0. length: l, half the sum of both distances' rest lengths [m]. rest: |kb| without a force. float64
    [bending_count].
    """

    triple: np.ndarray
    stiffness: np.ndarray
    length: np.ndarray
    rest: np.ndarray

    def __len__(self) -> int:
        return len(self.triple)

    def valence(self, count: np.ndarray) -> None:
        """Add each particle's number of constraints to `count` [particle_count]."""
        np.add.at(count, self.triple.ravel(), 1)

    def subset(self, which: np.ndarray) -> BendingSet:
        """Some of the triples."""
        return BendingSet(self.triple[which], self.stiffness[which], self.length[which], self.rest[which])

    def binormal(self, x: np.ndarray) -> np.ndarray:
        """kb of every triple, float64 [bending_count, 3]; not finite where links fold back on each other."""
        t1, t2 = directions(x, self.triple)
        return np.asarray(2.0 * np.cross(t1, t2) / (1.0 + np.sum(t1 * t2, axis=1))[:, None])

    def curvature(self, x: np.ndarray) -> np.ndarray:
        """|kb| / l of every triple [1/m], float64 [bending_count]."""
        return np.asarray(np.linalg.norm(self.binormal(x), axis=1) / self.length)

    def energy(self, x: np.ndarray) -> np.ndarray:
        """E of every triple [J], float64 [bending_count], the tip of the cone rounded (kernels/bending.py)."""
        square = np.sum(self.binormal(x) ** 2, axis=1)
        r = np.where(self.rest > 0.0, ROUNDED, 0.0)
        off = np.sqrt(square + r * self.rest**2) - np.sqrt(1.0 + r) * self.rest
        return np.asarray(0.5 * (1.0 + r) * self.stiffness / self.length * off**2)

    def force(self, x: np.ndarray) -> np.ndarray:
        """On every particle [N], float64 [particle_count, 3]: minus the gradient of all energy."""
        e = np.diff(x[self.triple], axis=1)
        size = np.maximum(np.linalg.norm(e, axis=2, keepdims=True), 1e-300)
        t1, t2 = np.moveaxis(e / size, 1, 0)
        c = np.sum(t1 * t2, axis=1, keepdims=True)
        square = 4.0 * (1.0 - c) / (1.0 + c)
        rest = self.rest[:, None]
        r = np.where(rest > 0.0, ROUNDED, 0.0)
        cone = np.sqrt(np.maximum(square + r * rest**2, 1e-300))
        slope = -4.0 * (1.0 + r) * (1.0 - np.sqrt(1.0 + r) * rest / cone) / (1.0 + c) ** 2
        slope *= (self.stiffness / self.length)[:, None]
        along1, along2 = slope * (t2 - c * t1) / size[:, 0], slope * (t1 - c * t2) / size[:, 1]
        out = np.zeros_like(x)
        for particle, each in zip(self.triple.T, (along1, along2 - along1, -along2), strict=True):
            np.add.at(out, particle, each)
        return out

    def folded(self, x: np.ndarray) -> np.ndarray:
        """Of which triples kb is singular, as numbers of them: links that fold back, or have no length."""
        t1, t2 = directions(x, self.triple)
        none = np.all(t1 == 0.0, axis=1) | np.all(t2 == 0.0, axis=1)
        return np.flatnonzero((1.0 + np.sum(t1 * t2, axis=1) < FOLDED) | none)


ROUNDED = 0.01
"""How the cone's tip is rounded; the same as in kernels/bending.py."""


def directions(x: np.ndarray, triple: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of both links of triples, float64 [n, 3] each; 0 where there is none."""
    e = np.diff(x[triple], axis=1)
    length = np.linalg.norm(e, axis=2, keepdims=True)
    t = np.divide(e, length, out=np.zeros_like(e), where=length > 0.0)
    return t[:, 0], t[:, 1]


def rest_turns(x: np.ndarray, triple: np.ndarray, rest_shape: str) -> np.ndarray:
    """|kb| at rest of triples of a shape, float64 [n].

    Raises:
        InputError: as_built, but folded back.
    """
    if rest_shape == "straight":
        return np.zeros(len(triple))
    t1, t2 = directions(x, triple)
    c = np.sum(t1 * t2, axis=1)
    back = np.flatnonzero(1.0 + c < FOLDED)
    if back.size:
        raise InputError(
            f"the links at particle {triple[back[0], 1]} fold back on each other, which is no shape to keep: "
            "use rest_shape='straight', or other points"
        )
    return np.asarray(np.linalg.norm(2.0 * np.cross(t1, t2), axis=1) / (1.0 + c))


def lengths_of(triple: np.ndarray, edge: np.ndarray, rest_length: np.ndarray) -> np.ndarray:
    """l of triples, half the sum of the rest lengths of their distances [m], float64 [n].

    Raises:
        InputError: a triple that is no path of two distances, or of such that have no length.
    """
    count = int(max(triple.max(initial=0), edge.max(initial=0))) + 1

    def key(pairs: np.ndarray) -> np.ndarray:
        return np.asarray(pairs.min(axis=-1).astype(np.int64) * count + pairs.max(axis=-1))

    known, which = np.unique(key(edge), return_index=True)
    wanted = key(np.stack([triple[:, :2], triple[:, 1:]], axis=1))
    at = np.minimum(np.searchsorted(known, wanted), max(len(known) - 1, 0))
    joined = known[at] == wanted if len(known) else np.zeros(wanted.shape, bool)
    bad = np.flatnonzero(~joined.all(axis=1) | (triple[:, 0] == triple[:, 2]))
    if bad.size:
        i, j, k = triple[bad[0]]
        raise InputError(
            f"bending at particles {i}, {j}, {k} needs a path: three different ones, with a distance from {i} to {j} "
            f"and from {j} to {k}"
        )
    length = 0.5 * rest_length[which[at]].sum(axis=1)
    none = np.flatnonzero(length == 0.0)
    if none.size:
        raise InputError(f"bending at particle {triple[none[0], 1]} needs distances that have a length")
    return np.asarray(length)
