"""Constraints as a model holds them: float64 numpy arrays, and what can be said of them without a device."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pbd_warp.errors import InputError


@dataclass(frozen=True)
class DistanceSet:
    """|x_i - x_j| = rest_length for each edge.

    edge: int32 [edge_count, 2]. rest_length [m], stiffness 0..1, compliance [m/N]: float64 [edge_count].
    """

    edge: np.ndarray
    rest_length: np.ndarray
    stiffness: np.ndarray
    compliance: np.ndarray

    def __len__(self) -> int:
        return len(self.edge)

    def valence(self, count: np.ndarray) -> None:
        """Add each particle's number of constraints to `count` [particle_count]."""
        np.add.at(count, self.edge.ravel(), 1)

    def residual(self, x: np.ndarray) -> np.ndarray:
        """C of every edge [m], float64 [edge_count]."""
        return np.linalg.norm(x[self.edge[:, 0]] - x[self.edge[:, 1]], axis=1) - self.rest_length

    def subset(self, which: np.ndarray) -> DistanceSet:
        """Some of the edges."""
        return DistanceSet(self.edge[which], self.rest_length[which], self.stiffness[which], self.compliance[which])


@dataclass(frozen=True)
class PointSet:
    """x_i = target for each locked particle.

    particle: int32 [point_count]. target [m]: float64 [point_count, 3]. stiffness 0..1 and
    compliance [m/N]: float64 [point_count].
    """

    particle: np.ndarray
    target: np.ndarray
    stiffness: np.ndarray
    compliance: np.ndarray

    def __len__(self) -> int:
        return len(self.particle)

    def valence(self, count: np.ndarray) -> None:
        """Add each particle's number of constraints to `count` [particle_count]."""
        np.add.at(count, self.particle, 1)

    def residual(self, x: np.ndarray, target: np.ndarray) -> np.ndarray:
        """Distance of each locked particle from its target [m], float64 [point_count]."""
        return np.linalg.norm(x[self.particle] - target, axis=1)


def check_softness(name: str, stiffness: np.ndarray, compliance: np.ndarray) -> None:
    """Stiffness and compliance are two models of the same softness; one constraint takes one of them."""
    both = np.flatnonzero((stiffness < 1.0) & (compliance > 0.0))
    if both.size:
        raise InputError(f"{name} has a stiffness below 1 and a compliance above 0: give it one of the two")


def check_capsules(distance: DistanceSet, radius: np.ndarray) -> None:
    """Whether distances can be capsules of their particles' radii, which link contacts take them to be."""
    of_ends = radius[distance.edge]
    none = np.flatnonzero(np.any(of_ends == 0.0, axis=1))
    if none.size:
        i, j = distance.edge[none[0]]
        raise InputError(
            f"the link of particles {i} and {j} has a radius of 0, and links that collide have a thickness: "
            "give its particles a radius"
        )
    thick = of_ends.sum(axis=1)
    stout = np.flatnonzero(thick > distance.rest_length)
    if stout.size:
        k = stout[0]
        i, j = distance.edge[k]
        raise InputError(
            f"the link of particles {i} and {j} is {thick[k]:.3g} m thick and {distance.rest_length[k]:.3g} m long, "
            "and links that collide are taken to be longer than thick: use fewer points, or a smaller radius"
        )
