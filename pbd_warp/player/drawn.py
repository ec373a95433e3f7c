"""What a picture of particles shows, but for where they are: balls, links between them, planes and spheres around."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pbd_warp.drawing.solids import DrawnSolid, drawn_solids
from pbd_warp.drawing.surroundings import EDGE_WIDTH, FLAT, ROPE_WIDTH, UPRIGHT, plane_polygons, wall
from pbd_warp.kernels.shapes import PLANE, SPHERE
from pbd_warp.model.model import Model
from pbd_warp.usd.surroundings import flattest_axis
from pbd_warp.usd.writer import loose_edges, shown_widths


@dataclass(frozen=True)
class Drawn:
    """Float64 arrays, lengths in metres.

    radius: Of the balls, [particle_count]. fixed: Which of them do not move, [fixed_count]. links: Pairs of them,
    [link_count, 2]; link_radius, rest_length: [link_count]. plane_point, plane_normal: [plane_count, 3].
    spheres: Centre and radius, [sphere_count, 4]. solids: All other colliders.
    """

    radius: np.ndarray
    fixed: np.ndarray
    links: np.ndarray
    link_radius: np.ndarray
    rest_length: np.ndarray
    plane_point: np.ndarray
    plane_normal: np.ndarray
    spheres: np.ndarray
    solids: Sequence[DrawnSolid] = ()

    @classmethod
    def of_model(cls, model: Model, places: tuple[np.ndarray, np.ndarray] | None = None) -> Drawn:
        """As the live view draws it. places: Where colliders are at the start, `Simulation.collider_places`."""
        radius = 0.5 * shown_widths(model)
        edge = model.distance.edge
        width = np.where(loose_edges(model), EDGE_WIDTH, ROPE_WIDTH)
        fixed = model.w == 0.0
        fixed[model.point.particle] = True
        ball = (model.colliders.kind == SPHERE) & (model.colliders.moves == 0)
        flat = model.colliders.kind == PLANE
        return cls(
            radius=radius,
            fixed=np.flatnonzero(fixed),
            links=edge,
            link_radius=width * radius[edge].min(axis=1),
            rest_length=model.distance.rest_length,
            plane_point=model.colliders.centre[flat],
            plane_normal=model.colliders.size[flat],
            spheres=np.column_stack([model.colliders.centre[ball], model.colliders.size[ball, 0]]),
            solids=drawn_solids(model, places),
        )

    def around(self, x: np.ndarray) -> dict[str, Any]:
        """Everything about a motion x [frame_count, particle_count, 3] that the page's drawing wants to know once,
        ready for JSON: what `pbd_warp.drawing.surroundings.describe` gives, for the box that the motion stays in."""
        reach = self.radius[:, None]
        low = (x - reach).min(axis=(0, 1)).astype(np.float64)
        high = (x + reach).max(axis=(0, 1)).astype(np.float64)
        size = np.ptp(x.reshape(-1, 3), axis=0)
        flattest = flattest_axis(size)
        axis = flattest if size[flattest] <= FLAT * max(size.max(), 1e-3) else None
        planes = plane_polygons(self.plane_point, self.plane_normal, low, high, axis)
        level = self.plane_point[self.plane_normal[:, 1] > UPRIGHT, 1]
        return {
            "radius": self.radius.tolist(),
            "fixed": self.fixed.tolist(),
            "links": self.links.tolist(),
            "link_radius": self.link_radius.tolist(),
            "rest_length": self.rest_length.tolist(),
            "planes": [polygon.tolist() for polygon, _ in planes],
            "walls": [wall(polygon, n, low, high, axis).tolist() for polygon, n in planes if axis is not None],
            "solids": [solid.to_json() for solid in self.solids],
            "spheres": self.spheres.tolist(),
            "low": low.tolist(),
            "high": high.tolist(),
            "ground": float(level.max()) if len(level) and axis is None else None,
            "axis": axis,
        }
