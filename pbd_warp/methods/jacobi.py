"""Jacobi: all constraints see the same positions, their corrections are summed, then applied at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.kernels.jacobi import add_corrections

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation

AVERAGINGS = ("mass-splitting", "valence", "none")


@dataclass(frozen=True)
class Jacobi:
    """Jacobi sweeps with atomic accumulation.

    Args:
        iterations: Sweeps a substep (solverIterations of the paper), at least 1.
        relaxation: Factor on every correction. Converges for 0 < relaxation < 2 with mass splitting on every graph;
            with the others the limit depends on the graph.
        averaging: What becomes of n_i constraints that all move particle i.
            "mass-splitting" (Tonge et al. 2012, Mass Splitting for Jitter-Free Parallel Rigid Body Simulation): each
            gets a share m_i / n_i of the mass, so n_i w_i stands in the denominator and w_i in the correction.
            Keeps momentum.
            "none": the plain sum. Keeps momentum; fails where many constraints meet (a star of 7 in the plane).
            "valence": each particle's sum over its own n_i. Leaks momentum where the n_i differ.

    Raises:
        InputError: iterations < 1, relaxation <= 0, or >= 2 with mass splitting, an unknown averaging.
    """

    iterations: int = 20
    relaxation: float = 1.0
    averaging: str = "mass-splitting"

    def __post_init__(self) -> None:
        check.whole("iterations", self.iterations, low=1)
        check.number("relaxation", self.relaxation, above=0.0)
        if self.averaging not in AVERAGINGS:
            raise unknown("averaging", self.averaging, AVERAGINGS)
        if self.averaging == "mass-splitting" and self.relaxation >= 2.0:
            raise InputError(
                f"relaxation must be in (0, 2) with mass splitting, no graph converges beyond; not {self.relaxation:g}"
            )

    def bind(self, sim: Simulation) -> JacobiSolver:
        return JacobiSolver(self, sim)


class JacobiSolver:
    """Lines 9-11 on one simulation."""

    def __init__(self, method: Jacobi, sim: Simulation):
        if method.averaging == "valence" and (
            np.any(sim.model.distance.compliance > 0.0) or np.any(sim.model.point.compliance > 0.0)
        ):
            raise InputError(
                "compliance needs averaging 'mass-splitting' or 'none': 'valence' moves the particles by "
                "less than the multipliers say"
            )
        self._sim = sim
        self._method = method
        self._correction = sim.allocate("jacobi.correction", sim.model.particle_count, sim.vec3)
        self._share = sim.share if method.averaging == "mass-splitting" else None
        self._divisor = sim.share if method.averaging == "valence" else None

    def solve(self) -> None:
        sim = self._sim
        for constraint in sim.constraints:
            constraint.begin()
        if not sim.constraints:
            return
        for _ in range(self._method.iterations):
            for constraint in sim.constraints:
                constraint.project(sim.u, self._share, self._method.relaxation, self._correction)
            sim.launch(add_corrections, len(sim.u), self._divisor, self._correction, sim.u)
