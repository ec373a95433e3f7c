"""Forces that constraints carried in the last step, from their multipliers, in float64 on the host."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pbd_warp.model.model import Model


class KeepsMultipliers(Protocol):
    """A solver that knows the forces of what it has solved."""

    def tension(self) -> np.ndarray: ...
    def point_reaction(self) -> np.ndarray: ...
    def contact_force(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Forces:
    """Means over the last step, all zero before the first one.

    tension: Along each distance [N], pull positive, float64 [distance_count].
    reaction: Of what holds a particle, a point constraint or its being fixed or grabbed, on that particle [N], float64
        [particle_count, 3]; 0 for the others. Weight does not count on fixed particles, which have no mass.
    moment: Of a clamp, two held particles next to each other at an end of a triple that resists bending, about the
        middle between them, on the rope [N m], float64 [bending_count, 3]; 0 for triples that no clamp holds.
    contact: Of colliders and of other particles and links on each particle, friction included [N], float64
        [particle_count, 3].
    """

    tension: np.ndarray
    reaction: np.ndarray
    moment: np.ndarray
    contact: np.ndarray


def constraint_forces(model: Model, solver: KeepsMultipliers, x: np.ndarray, w: np.ndarray) -> Forces:
    """The forces that a solver has found.

    Args:
        x: Positions after the step [m], float64 [particle_count, 3].
        w: Inverse masses [1/kg], 0 of what is fixed or grabbed, float64 [particle_count].
    """
    tension, contact = solver.tension(), solver.contact_force()
    i, j = model.distance.edge.T
    d = x[j] - x[i]
    length = np.linalg.norm(d, axis=1, keepdims=True)
    pull = tension[:, None] * np.divide(d, length, out=np.zeros_like(d), where=length > 0.0)
    on_particle = contact + model.bending.force(x)
    np.add.at(on_particle, i, pull)
    np.subtract.at(on_particle, j, pull)
    reaction = np.where(w[:, None] == 0.0, -on_particle, 0.0)
    held = model.point.particle[w[model.point.particle] > 0.0]
    np.add.at(reaction, held, solver.point_reaction()[w[model.point.particle] > 0.0])
    return Forces(tension, reaction, _clamps(model, x, w, reaction), contact)


def _clamps(model: Model, x: np.ndarray, w: np.ndarray, reaction: np.ndarray) -> np.ndarray:
    """Moments of what holds two neighbours at an end of a triple, about the middle between them."""
    moment = np.zeros((len(model.bending), 3))
    for ends in model.bending.triple[:, :2], model.bending.triple[:, 1:]:
        clamp = np.all(w[ends] == 0.0, axis=1) & np.any(w[model.bending.triple] > 0.0, axis=1)
        lever = 0.5 * (x[ends[clamp, 1]] - x[ends[clamp, 0]])
        moment[clamp] += np.cross(lever, reaction[ends[clamp, 1]] - reaction[ends[clamp, 0]])
    return moment
