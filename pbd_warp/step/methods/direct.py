"""Direct: Newton's method on all distances of a path at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.kernels.direct import add_corrections_to_both, solve_paths
from pbd_warp.kernels.precision import PRECISIONS
from pbd_warp.step.constraints.distance import LimitedLengths
from pbd_warp.step.methods.iteration import check_iterations

if TYPE_CHECKING:
    from pbd_warp.model.model import Model
    from pbd_warp.simulation import Simulation

ROUND_OFF = 16.0
"""The tolerance by default, in machine epsilons of the longest link."""


@dataclass(frozen=True)
class Direct:
    """Newton's method with an elimination along each path, O(links), one thread a path (kernels/direct.py).

    For graphs whose connected pieces are all paths: ropes, chains, single particles; particles fixed, grabbed or locked
    to a point anywhere in them. Converges in a handful of iterations whatever the length, mass ratio and step.

    Args:
        iterations: Newton iterations a substep at most.
        tolerance: Stop when what is left of |C| and of the momentum balance, estimated from the step just made, is
            under it [m]; None: 16 machine epsilons of the longest link, and what ends within epsilon^(2/3) of it counts
            as converged. It stops too when its steps are at round-off and shrink no more.

    Constraints that nothing can satisfy, such as a rope held further apart than its length, make it diverge.

    With contacts a substep makes `iterations` rounds of one Jacobi sweep over the contacts and a Newton solution.

    Raises:
        InputError: iterations < 1, tolerance <= 0; when bound to a simulation: a graph that branches or closes or has
            no distances, a stiffness below 1, a rest length of 0, two point constraints at one particle.
    """

    name: ClassVar[str] = "direct"
    remedy: ClassVar[str] = (
        "a rope that is held further apart than its length has no solution for it: use 'jacobi' there, or a compliance"
    )

    iterations: int = 30
    tolerance: float | None = None

    def __post_init__(self) -> None:
        check_iterations(self.iterations, self.tolerance)

    def valence(self, model: Model) -> np.ndarray:
        """No mass is shared but among contacts."""
        return np.zeros(model.particle_count, np.int32)

    def bind(self, sim: Simulation) -> DirectSolver:
        return DirectSolver(self, sim)


class DirectSolver:
    """Lines 9-11 on one simulation."""

    def __init__(self, method: Direct, sim: Simulation):
        self._sim = sim
        self._method = method
        model = sim.model
        edges, points = model.distance, model.point
        _refuse(model)
        vertex, first, link = paths(edges.edge, points.particle)
        place = len(vertex)
        self._first = sim.upload("direct.first", first, wp.int32)
        self._vertex = sim.upload("direct.vertex", vertex, wp.int32)
        rest_length = sim.upload("direct.rest_length", _spread(edges.rest_length, link, 1.0))
        along = np.stack([vertex, np.where(link >= 0, np.append(vertex[1:], -1), vertex)], axis=1)
        soft = _spread(edges.compliance, link, 0.0) > 0.0
        self._recovering = LimitedLengths(sim, "direct", sim.upload("direct.edge", along, wp.vec2i), rest_length, soft)
        self._compliance = self._point = self._target = self._point_compliance = None
        if np.any(edges.compliance > 0.0):
            self._compliance = sim.upload("direct.compliance", _spread(edges.compliance, link, 0.0))
        if len(points):
            at = np.full(model.particle_count, -1)
            at[points.particle] = np.arange(len(points))
            self._point = sim.upload("direct.point", at[vertex], wp.int32)
            self._target = sim.bind_points().target
            if np.any(points.compliance > 0.0):
                self._point_compliance = sim.upload("direct.point_compliance", points.compliance)
        self._base = sim.allocate("direct.base", model.particle_count, sim.vec3)
        mat33 = PRECISIONS[sim.real]["Mat33"]
        scratch = {"inverse": mat33, "solution": sim.vec3, "gradient": sim.vec3, "normal": sim.vec3}
        scratch |= {"kappa": sim.real, "lam_gain": sim.vec3, "lam_solution": sim.real}
        self._scratch = [sim.allocate(f"direct.{name}", place, dtype) for name, dtype in scratch.items()]
        self._lam = sim.allocate("direct.lam", place, sim.real)
        longest = float(edges.rest_length.max())
        epsilon = float(np.finfo(model.dtype).eps)
        self._round_off = ROUND_OFF * epsilon
        self._tolerance, self._accepted = self._round_off * longest, epsilon ** (2.0 / 3.0) * longest
        if method.tolerance is not None:
            self._tolerance = self._accepted = method.tolerance
        self._counters = sim.count_iterations()
        if sim.contacts:
            self._correction = sim.allocate("direct.correction", model.particle_count, sim.vec3)

    def restart(self) -> None:
        """Forget the multipliers, which a step takes from the one before as a first guess."""
        self._lam.zero_()

    def solve(self) -> None:
        sim = self._sim
        sim.launch.copy(self._base, sim.u)
        self._recovering.begin()
        if not sim.contacts:
            self._newton(sim.lam_scale)
            return
        sim.contacts.begin()
        for k in range(self._method.iterations):
            sim.contacts.project(sim.u, sim.share, 1.0, None, self._correction)
            sim.launch(add_corrections_to_both, len(sim.u), self._correction, self._base, sim.u)
            self._newton(sim.lam_scale if k == 0 else 1.0)

    def _newton(self, lam_scale: float) -> None:
        sim = self._sim
        sim.launch(
            solve_paths,
            len(self._first) - 1,
            *(self._first, self._vertex, self._recovering.rest_now, self._compliance),
            *(self._point, self._target, self._point_compliance),
            *(sim.state.x, sim.w),
            *(self._base, sim.per_force, sim.integrator.mean_gradient, lam_scale),
            *(self._method.iterations, self._tolerance, self._accepted, self._round_off),
            *self._scratch,
            *(self._lam, sim.u, *self._counters),
        )


def _refuse(model: Model) -> None:
    if not len(model.distance):
        raise InputError("method 'direct' solves distances, and this model has none: use 'jacobi' or 'gauss-seidel'")
    if np.any(model.distance.stiffness < 1.0) or np.any(model.point.stiffness < 1.0):
        raise InputError("method 'direct' solves exactly: soften with compliance instead of a stiffness below 1")
    if np.any(model.distance.rest_length == 0.0):
        raise InputError(
            "method 'direct' needs rest lengths above 0: join coincident particles into one, or use 'jacobi'"
        )
    twice = np.flatnonzero(np.bincount(model.point.particle) > 1)
    if twice.size:
        raise InputError(f"method 'direct' takes one point constraint a particle, but particle {twice[0]} has more")


def _spread(values: np.ndarray, link: np.ndarray, none: float) -> np.ndarray:
    """`values` of the links at their places along the paths, `none` where a path ends."""
    return np.where(link >= 0, np.append(values, none)[link], none)


def paths(edge: np.ndarray, locked: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A graph as paths: vertex [p] along all of them, first [paths + 1], link [p], the edge to the next vertex or -1.

    Particles without an edge are left out, but for the `locked` ones. Raises an InputError for a graph that is no set
    of paths.
    """
    count = int(max(edge.max(initial=-1), locked.max(initial=-1))) + 1
    degree = np.bincount(edge.ravel(), minlength=count)
    hint = "method 'direct' needs paths (ropes, chains); use 'jacobi' or 'gauss-seidel' for this graph"
    if np.any(degree > 2):
        raise InputError(f"particle {int(np.argmax(degree > 2))} has {degree.max()} distances: {hint}")
    around: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for number, (i, j) in enumerate(edge.tolist()):
        around[i].append((j, number))
        around[j].append((i, number))
    vertex: list[int] = []
    link: list[int] = []
    first = [0]
    done = np.zeros(count, bool)
    for end in [*np.flatnonzero(degree == 1).tolist(), *locked[degree[locked] == 0].tolist()]:
        if done[end]:
            continue
        at, came_by = end, -1
        while at >= 0:
            done[at] = True
            vertex.append(at)
            ahead = [(to, number) for to, number in around[at] if number != came_by]
            at, came_by = ahead[0] if ahead else (-1, -1)
            link.append(came_by)
        first.append(len(vertex))
    closed = np.flatnonzero((degree > 0) & ~done)
    if closed.size:
        raise InputError(f"particle {closed[0]} is part of a closed loop: {hint}")
    return np.array(vertex, np.int32), np.array(first, np.int32), np.array(link, np.int32)
