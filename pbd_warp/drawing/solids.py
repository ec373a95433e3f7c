"""Colliders other than planes as triangles, for what draws them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pbd_warp.kernels.shapes import MESH, PLANE, SPHERE
from pbd_warp.model.model import Model
from pbd_warp.model.rotation import rotate
from pbd_warp.model.tessellation import tessellated


@dataclass(frozen=True)
class DrawnSolid:
    """points [m], [n, 3], around `centre` [m], as they are at the start; triangles [m, 3]. Then it moves with velocity
    [m/s] and spin [rad/s]."""

    points: np.ndarray
    triangles: np.ndarray
    centre: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray

    def to_json(self) -> dict[str, Any]:
        return {name: values.tolist() for name, values in vars(self).items()}

    @property
    def moves(self) -> bool:
        return bool(np.any(self.velocity) or np.any(self.spin))

    def at(self, time: float) -> np.ndarray:
        """Its points in the world then [m], [n, 3]."""
        angle = float(np.linalg.norm(self.spin)) * time
        axis = self.spin / (np.linalg.norm(self.spin) or 1.0)
        q = np.append(np.sin(0.5 * angle) * axis, np.cos(0.5 * angle))
        return rotate(q, self.points) + self.centre + time * self.velocity


def drawn_solids(model: Model, places: tuple[np.ndarray, np.ndarray] | None = None) -> list[DrawnSolid]:
    """Of a model, but for its planes and its spheres at rest.

    Args:
        places: Where colliders are at the start, `Simulation.collider_places`; where the model has them unless given.
    """
    c = model.colliders
    centre, rotation = (c.centre, c.rotation) if places is None else places
    solids = []
    for k in range(len(c)):
        if c.kind[k] == PLANE or (c.kind[k] == SPHERE and not c.moves[k]):
            continue
        points, triangles = c.mesh(k) if c.kind[k] == MESH else tessellated(int(c.kind[k]), c.size[k])
        solids.append(DrawnSolid(rotate(rotation[k], points), triangles, centre[k], c.velocity[k], c.spin[k]))
    return solids
