"""Gauss-Seidel: every constraint sees what the ones before it did; those that share no particle go at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import warp as wp

from pbd_warp.kernels.jacobi import add_corrections
from pbd_warp.step.methods.iteration import Iterations, check_iterations

if TYPE_CHECKING:
    from pbd_warp.model.model import Model
    from pbd_warp.simulation import Simulation


@dataclass(frozen=True)
class GaussSeidel:
    """Coloured Gauss-Seidel: the kernels of Jacobi with u itself as output, one launch a colour.

    Args:
        iterations: Sweeps a substep, at least 1; with a tolerance at most so many.
        tolerance: Stop when the largest |C| [m] that a sweep met is under it; None: always all iterations.

    Contacts change from step to step and have no colours: in every sweep they come last, as one Jacobi sweep with
    split masses.

    Raises:
        InputError: iterations < 1, tolerance <= 0.
    """

    name: ClassVar[str] = "gauss-seidel"
    remedy: ClassVar[str] = "try more substeps"

    iterations: int = 20
    tolerance: float | None = None

    def __post_init__(self) -> None:
        check_iterations(self.iterations, self.tolerance)

    def valence(self, model: Model) -> np.ndarray:
        """No mass is shared but among contacts."""
        return np.zeros(model.particle_count, np.int32)

    def bind(self, sim: Simulation) -> GaussSeidelSolver:
        return GaussSeidelSolver(self, sim)


class GaussSeidelSolver:
    """Lines 9-11 on one simulation."""

    def __init__(self, method: GaussSeidel, sim: Simulation):
        self._sim = sim
        edges, points = sim.model.distance, sim.model.point
        self._groups: list = [
            edges.subset(group).bind(sim, f"distance.{colour}") for colour, group in enumerate(colours(edges.edge))
        ]
        if len(points):
            self._groups.append(sim.bind_points())
        self._iterations = Iterations(sim, method.iterations, method.tolerance)
        if sim.contacts:
            self._correction = sim.allocate("gauss_seidel.correction", sim.model.particle_count, sim.vec3)

    def restart(self) -> None:
        """Nothing is kept from step to step."""

    def solve(self) -> None:
        contacts = [self._sim.contacts] if self._sim.contacts else []
        if not self._groups and not contacts:
            return
        for constraint in (*self._groups, *contacts):
            constraint.begin()
        self._iterations.run(self._project, self._apply)

    def _project(self) -> None:
        sim = self._sim
        for group in self._groups:
            group.project(sim.u, None, 1.0, self._iterations.residual, sim.u)
        if sim.contacts:
            sim.contacts.project(sim.u, sim.share, 1.0, self._iterations.residual, self._correction)

    def _apply(self, _: int) -> None:
        if self._sim.contacts:
            self._sim.launch(add_corrections, len(self._sim.u), None, self._correction, self._sim.u)


def colours(edge: np.ndarray) -> list[np.ndarray]:
    """Groups of edges of which no two share a particle: a colouring of the graph whose nodes are the edges."""
    m = len(edge)
    if m == 0:
        return []
    # Edges around a particle are neighbours of each other: all pairs within each run of equal particles.
    order = np.argsort(edge.ravel(), kind="stable")
    particle, owner = edge.ravel()[order], order // 2
    pairs = []
    for distance in range(1, int(np.bincount(particle).max())):
        same = particle[distance:] == particle[:-distance]
        pairs.append(np.stack([owner[distance:][same], owner[:-distance][same]], axis=1))
    conflicts = np.concatenate(pairs) if pairs else np.zeros((0, 2), int)
    conflicts = np.unique(np.sort(conflicts[conflicts[:, 0] != conflicts[:, 1]], axis=1), axis=0).astype(np.int32)
    colour = np.zeros(m, np.int32)
    if len(conflicts):
        host = next(device for device in wp.get_devices() if device.is_cpu)  # the colouring runs there
        nodes = wp.zeros(m, dtype=wp.int32, device=host)
        wp.utils.graph_coloring_assign(wp.array(conflicts, dtype=wp.int32, device=host), nodes)
        colour = nodes.numpy()
    return [np.flatnonzero(colour == c) for c in np.unique(colour)]
