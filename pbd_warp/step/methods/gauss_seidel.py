"""Gauss-Seidel: every constraint sees what the ones before it did; those that share no particle go at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import warp as wp

from pbd_warp.kernels.jacobi import add_corrections
from pbd_warp.model.model import Model
from pbd_warp.step.constraints.bending import Bends
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.constraints.distance import Distances
from pbd_warp.step.constraints.point import Points
from pbd_warp.step.context import Context, Stage
from pbd_warp.step.methods.iteration import Iterations, check_iterations


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
    remedy: ClassVar[str] = ""
    keeps_forces: ClassVar[bool] = False

    iterations: int = 20
    tolerance: float | None = None

    def __post_init__(self) -> None:
        check_iterations(self.iterations, self.tolerance)

    def valence(self, model: Model) -> np.ndarray:
        """No mass is shared but among contacts."""
        return np.zeros(model.particle_count, np.int32)

    def bind(self, context: Context, contacts: ContactConstraints | None) -> GaussSeidelSolver:
        return GaussSeidelSolver(self, context, contacts)


class GaussSeidelSolver:
    """Lines 9-11 on one model."""

    def __init__(self, method: GaussSeidel, context: Context, contacts: ContactConstraints | None):
        self._context = context
        self._contacts = contacts
        edges, points, bending = context.model.distance, context.model.point, context.model.bending
        self._groups: list[Distances | Points | Bends] = [
            Distances(context, edges.subset(group), method.iterations, f"distance.{colour}")
            for colour, group in enumerate(_colours_of_copies(edges.edge, context.model.copy_count))
        ]
        if len(points):
            self._groups.append(Points(context, method.iterations))
        self._groups += [
            Bends(context, bending.subset(group), f"bending.{colour}")
            for colour, group in enumerate(colours(bending.triple))
        ]
        self._iterations = Iterations(context, method.iterations, method.tolerance)
        self.counters = self._iterations.counters
        if contacts:
            self._correction = context.allocate("gauss_seidel.correction", context.model.particle_count, context.vec3)

    def restart(self) -> None:
        """Nothing is kept from step to step."""

    def solve(self, stage: Stage) -> None:
        constraints = [*self._groups, *([self._contacts] if self._contacts else [])]
        if not constraints:
            return
        for constraint in constraints:
            constraint.begin(stage)
        self._iterations.run(lambda: self._project(stage), self._apply)

    def _project(self, stage: Stage) -> None:
        u, residual = self._context.u, self._iterations.residual
        for group in self._groups:
            group.project(stage, u, None, 1.0, residual, u)
        if self._contacts:
            self._contacts.project(stage, u, self._contacts.valence, 1.0, residual, self._correction)

    def _apply(self, _: int) -> None:
        if self._contacts:
            u = self._context.u
            self._context.launch(add_corrections, len(u), None, self._correction, u)


def _colours_of_copies(edge: np.ndarray, copies: int) -> list[np.ndarray]:
    """Every copy is coloured as the first, so that it is solved as it would be alone."""
    m = len(edge) // copies
    return [(np.arange(copies)[:, None] * m + group).ravel() for group in colours(edge[:m])]


def colours(edge: np.ndarray) -> list[np.ndarray]:
    """Groups of edges (or triples, [m, width]) of which no two share a particle: a colouring of the graph whose nodes
    are the edges."""
    m = len(edge)
    if m == 0:
        return []
    # Edges around a particle are neighbours of each other: all pairs within each run of equal particles.
    order = np.argsort(edge.ravel(), kind="stable")
    particle, owner = edge.ravel()[order], order // edge.shape[1]
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
