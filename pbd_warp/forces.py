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
    contact: Of colliders on each particle, friction included [N], float64 [particle_count, 3].
    """

    tension: np.ndarray
    reaction: np.ndarray
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
    on_particle = contact.copy()
    np.add.at(on_particle, i, pull)
    np.subtract.at(on_particle, j, pull)
    reaction = np.where(w[:, None] == 0.0, -on_particle, 0.0)
    held = model.point.particle[w[model.point.particle] > 0.0]
    np.add.at(reaction, held, solver.point_reaction()[w[model.point.particle] > 0.0])
    return Forces(tension, reaction, contact)
