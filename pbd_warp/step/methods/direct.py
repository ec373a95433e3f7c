"""Direct: Newton's method on all distances of a path at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.kernels.direct import add_corrections_to_both, solve_paths
from pbd_warp.model.model import Model
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.constraints.distance import LimitedLengths
from pbd_warp.step.context import Context, Stage
from pbd_warp.step.methods.iteration import check_iterations

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
        "'jacobi' or a compliance where a rope is held further apart than its length: that has no solution"
    )

    iterations: int = 30
    tolerance: float | None = None

    def __post_init__(self) -> None:
        check_iterations(self.iterations, self.tolerance)

    def valence(self, model: Model) -> np.ndarray:
        """No mass is shared but among contacts."""
        return np.zeros(model.particle_count, np.int32)

    def bind(self, context: Context, contacts: ContactConstraints | None) -> DirectSolver:
        return DirectSolver(self, context, contacts)


class DirectSolver:
    """Lines 9-11 on one model."""

    def __init__(self, method: Direct, context: Context, contacts: ContactConstraints | None):
        self._context = context
        self._contacts = contacts
        self._method = method
        model = context.model
        edges, points = model.distance, model.point
        _refuse(model)
        vertex, first, link = paths(edges.edge, points.particle)
        place = len(vertex)
        self._first = context.upload("direct.first", first, wp.int32)
        self._vertex = context.upload("direct.vertex", vertex, wp.int32)
        rest_length = context.upload("direct.rest_length", _spread(edges.rest_length, link, 1.0))
        along = np.stack([vertex, np.where(link >= 0, np.append(vertex[1:], -1), vertex)], axis=1)
        soft = _spread(edges.compliance, link, 0.0) > 0.0
        self._lengths = LimitedLengths(
            context, "direct", context.upload("direct.edge", along, wp.vec2i), rest_length, soft
        )
        self._compliance = self._point = self._target = self._point_compliance = None
        if np.any(edges.compliance > 0.0):
            self._compliance = context.upload("direct.compliance", _spread(edges.compliance, link, 0.0))
        if len(points):
            at = np.full(model.particle_count, -1)
            at[points.particle] = np.arange(len(points))
            self._point = context.upload("direct.point", at[vertex], wp.int32)
            self._target = context.point_target
            if np.any(points.compliance > 0.0):
                self._point_compliance = context.upload("direct.point_compliance", points.compliance)
        self._base = context.allocate("direct.base", model.particle_count, context.vec3)
        scratch = {"inverse": context.mat33, "solution": context.vec3, "gradient": context.vec3, "normal": context.vec3}
        scratch |= {"kappa": context.real, "lam_gain": context.vec3, "lam_solution": context.real}
        self._scratch = [context.allocate(f"direct.{name}", place, dtype) for name, dtype in scratch.items()]
        self._lam = context.allocate("direct.lam", place, context.real)
        longest = float(edges.rest_length.max())
        epsilon = float(np.finfo(model.dtype).eps)
        self._round_off = ROUND_OFF * epsilon
        self._tolerance, self._accepted = self._round_off * longest, epsilon ** (2.0 / 3.0) * longest
        if method.tolerance is not None:
            self._tolerance = self._accepted = method.tolerance
        self.counters = context.allocate("direct.counters", 2, wp.int32)
        if contacts:
            self._correction = context.allocate("direct.correction", model.particle_count, context.vec3)

    def restart(self) -> None:
        """Forget the multipliers, which a step takes from the one before as a first guess."""
        self._lam.zero_()

    def solve(self, stage: Stage) -> None:
        context = self._context
        launch, u = context.launch, context.u
        launch.copy(self._base, u)
        self._lengths.begin(stage)
        if not self._contacts:
            self._newton(stage, stage.lam_scale)
            return
        self._contacts.begin(stage)
        for k in range(self._method.iterations):
            self._contacts.project(stage, u, self._contacts.valence, 1.0, None, self._correction)
            launch(add_corrections_to_both, len(u), self._correction, self._base, u)
            self._newton(stage, stage.lam_scale if k == 0 else 1.0)

    def _newton(self, stage: Stage, lam_scale: float) -> None:
        context = self._context
        context.launch(
            solve_paths,
            len(self._first) - 1,
            *(self._first, self._vertex, self._lengths.now, self._compliance),
            *(self._point, self._target, self._point_compliance),
            *(context.state.x, context.w),
            *(self._base, stage.compliance_scale, stage.mean_gradient, lam_scale),
            *(self._method.iterations, self._tolerance, self._accepted, self._round_off),
            *self._scratch,
            *(self._lam, context.u, self.counters[0:1], self.counters[1:2]),
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
