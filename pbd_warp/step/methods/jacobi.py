"""Jacobi: all constraints see the same positions, their corrections are summed, then applied at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.kernels.jacobi import add_corrections, add_corrections_accelerated
from pbd_warp.model.model import Model
from pbd_warp.step.constraints.bending import Bends
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.constraints.distance import Distances
from pbd_warp.step.constraints.point import Points
from pbd_warp.step.context import Context, Stage
from pbd_warp.step.methods.iteration import Iterations, check_iterations
from pbd_warp.step.methods.spectrum import JacobiSweep

AVERAGINGS = ("mass-splitting", "valence", "none")

PLAIN_ITERATIONS = 10
"""Iterations before Chebyshev sets in (Wang 2015, section 4.2: the first ones are not yet governed by rho)."""


@dataclass(frozen=True)
class Jacobi:
    """Jacobi sweeps with atomic accumulation.

    Args:
        iterations: Sweeps a substep (solverIterations of the paper), at least 1; with a tolerance at most so many.
        relaxation: Factor on every correction. Converges for 0 < relaxation < 2 with mass splitting on every graph;
            with the others the limit depends on the graph.
        averaging: What becomes of n_i constraints that all move particle i.
            "mass-splitting" (Tonge et al. 2012, Mass Splitting for Jitter-Free Parallel Rigid Body Simulation): each
            gets a share m_i / n_i of the mass, so n_i w_i stands in the denominator and w_i in the correction.
            Keeps momentum.
            "none": the plain sum. Keeps momentum; fails where many constraints meet (a star of 7 in the plane).
            "valence": each particle's sum over its own n_i. Leaks momentum where the n_i differ.
        chebyshev: Spectral radius rho of the sweep, for Chebyshev's semi-iteration (Wang 2015): omega = 1 for 10
            iterations, then 2/(2 - rho^2), then 4/(4 - rho^2 omega). "auto" measures it on the graph as it is at the
            start (needs SciPy). For rigid constraints without contacts. Too large a rho for a moving scene is
            worse than none.
        tolerance: Stop when the largest |C| [m] falls under it; None: always all iterations.

    Raises:
        InputError: iterations < 1, relaxation <= 0, or >= 2 with mass splitting, an unknown averaging, chebyshev
            neither in (0, 1) nor "auto", tolerance <= 0.
    """

    name: ClassVar[str] = "jacobi"
    remedy: ClassVar[str] = "a smaller relaxation or averaging='mass-splitting'"
    keeps_forces: ClassVar[bool] = False

    iterations: int = 20
    relaxation: float = 1.0
    averaging: str = "mass-splitting"
    chebyshev: float | str | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        check_iterations(self.iterations, self.tolerance)
        check.number("relaxation", self.relaxation, above=0.0)
        if self.averaging not in AVERAGINGS:
            raise unknown("averaging", self.averaging, AVERAGINGS)
        if self.averaging == "mass-splitting" and self.relaxation >= 2.0:
            raise InputError(
                f"relaxation must be in (0, 2) with mass splitting, no graph converges beyond; not {self.relaxation:g}"
            )
        if self.chebyshev not in (None, "auto"):
            rho = check.number("chebyshev", self.chebyshev, above=0.0)
            if rho >= 1.0:
                raise InputError(f"chebyshev must be 'auto' or a spectral radius in (0, 1), not {rho:g}")

    def valence(self, model: Model) -> np.ndarray:
        """Constraints at each particle that share its mass, int32 [particle_count]; contacts come on top."""
        count = np.zeros(model.particle_count, np.int32)
        model.distance.valence(count)
        model.point.valence(count)
        model.bending.valence(count)
        return count

    def bind(self, context: Context, contacts: ContactConstraints | None) -> JacobiSolver:
        return JacobiSolver(self, context, contacts)


class JacobiSolver:
    """Lines 9-11 on one model."""

    def __init__(self, method: Jacobi, context: Context, contacts: ContactConstraints | None):
        model = context.model
        compliant = bool(np.any(model.distance.compliance > 0.0) or np.any(model.point.compliance > 0.0))
        soft = "bending" if len(model.bending) else "compliance" if compliant else ""
        if method.averaging == "valence" and soft:
            raise InputError(
                f"{soft} needs averaging 'mass-splitting' or 'none': 'valence' moves the particles by less than the "
                "multipliers say"
            )
        if method.chebyshev is not None and (soft or contacts):
            raise InputError(
                "chebyshev is for rigid constraints without contacts: leave it out, or use GaussSeidel or Direct"
            )
        self._context = context
        self._method = method
        self._constraints: list[Distances | Points | Bends | ContactConstraints] = []
        if len(model.distance):
            self._constraints.append(Distances(context, model.distance, method.iterations))
        if len(model.point):
            self._constraints.append(Points(context, method.iterations))
        if len(model.bending):
            self._constraints.append(Bends(context, model.bending))
        if contacts:
            self._constraints.append(contacts)
        self._correction = context.allocate("jacobi.correction", model.particle_count, context.vec3)
        valence = contacts.valence if contacts else context.upload("valence", method.valence(model), wp.int32)
        self._valence = valence if method.averaging == "mass-splitting" else None
        self._divisor = valence if method.averaging == "valence" else None
        self._iterations = Iterations(context, method.iterations, method.tolerance)
        self.counters = self._iterations.counters
        self._omega = None
        if method.chebyshev is not None and self._constraints:
            rho = spectral_radius(model, method) if method.chebyshev == "auto" else float(method.chebyshev)
            self._omega = context.upload("jacobi.omega", chebyshev_factors(rho, method.iterations))
            self._u_before = context.allocate("jacobi.u_before", model.particle_count, context.vec3)

    def restart(self) -> None:
        """Nothing is kept from step to step."""

    def solve(self, stage: Stage) -> None:
        if not self._constraints:
            return
        for constraint in self._constraints:
            constraint.begin(stage)
        self._iterations.run(lambda: self._project(stage), self._apply)

    def _project(self, stage: Stage) -> None:
        for constraint in self._constraints:
            constraint.project(
                *(stage, self._context.u, self._valence, self._method.relaxation),
                *(self._iterations.residual, self._correction),
            )

    def _apply(self, k: int) -> None:
        u, launch = self._context.u, self._context.launch
        if self._omega is None:
            launch(add_corrections, len(u), self._divisor, self._correction, u)
        else:
            launch(
                add_corrections_accelerated,
                len(u),
                *(self._divisor, self._omega[k:], self._iterations.count, self._iterations.another),
                *(self._correction, self._u_before, u),
            )


def chebyshev_factors(rho: float, iterations: int) -> np.ndarray:
    """omega of each iteration, float64 [iterations] (Wang 2015, algorithm 1)."""
    omega = np.ones(iterations)
    for k in range(PLAIN_ITERATIONS, iterations):
        omega[k] = 2.0 / (2.0 - rho**2) if k == PLAIN_ITERATIONS else 4.0 / (4.0 - rho**2 * omega[k - 1])
    return omega


def spectral_radius(model: Model, method: Jacobi) -> float:
    """rho of one sweep over a model's constraints, linearised where it is: 1 - relaxation * lambda_min."""
    lowest = JacobiSweep(model, method.averaging, method.valence(model)).smallest_eigenvalue()
    return float(np.clip(1.0 - method.relaxation * lowest, 1e-6, 1.0 - 1e-9))
