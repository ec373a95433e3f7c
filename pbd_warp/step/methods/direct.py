"""Direct: Newton's method on all constraints of a graph at once."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import pairwise
from typing import ClassVar

import numpy as np
import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.kernels import pieces
from pbd_warp.kernels.newton import solve_pieces
from pbd_warp.model.constraints import DistanceSet, PointSet
from pbd_warp.model.model import Model
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.constraints.distance import LimitedLengths
from pbd_warp.step.context import Context, Stage
from pbd_warp.step.methods.bends import bind_bends
from pbd_warp.step.methods.coupling import ContactSource, Coupling, PairSource, System, Tolerance
from pbd_warp.step.methods.iteration import check_iterations
from pbd_warp.step.methods.link_source import LinkSource
from pbd_warp.step.methods.schedule import Schedule, schedule
from pbd_warp.step.methods.touches import Touches

TOLERANCE = {"float32": 1e-10, "float64": 4e-15}
"""What is left of a length over its rest length, and of the balance over the forces, by default: round-off of what a
step computes with, which is float64; in float32 as much as velocities, which are its displacements, can show."""

ACCEPTED = {"float32": 1e-6, "float64": 1e-11}
"""What still counts as converged where the iterations end above the tolerance."""

COARSER = 100.0
"""Tolerances of links that gap, slip and force of a contact may be off by; besides, the rounding of positions."""

ACCEPTED_CONTACT = {"float32": 1e-7, "float64": 1e-9}
"""What of a contact still counts as converged where the iterations end above that, of its size and what it moves; in
float32 besides 10 times the rounding of positions."""

PROXIMAL = 1e-9
"""Of what moves both ends of a link: the compliance of a step of the proximal method; less in long pieces, and in such
of unlike masses, which are softer than a link alone. The smaller it is, the more rounding leaves of the balance."""

ELASTIC = 1e-12
"""The same of links that have to give."""

SOFTEST = 0.2
"""How much of a particle's inertia the negative stiffness of its links that push may take away. Tried on straight ropes
that are pushed together: 0 converges linearly, often too slowly; from 0.3 on it finds solutions of far more energy."""

REACH = 0.5
"""How far a link's ends may move apart in one iteration, over the mean length of the piece's links: beyond, directions
are new ones and Newton's method goes astray."""


@dataclass(frozen=True)
class Direct:
    """Newton's method with an elimination of each connected piece, on any graph (kernels/newton.py).

    A path or a tree costs O(links), a net of k x k O(k^3). Particles may be fixed, grabbed or locked to points
    anywhere; constraints may be redundant; those that contradict each other give as a rubber band would. Converges in a
    handful of iterations whatever the length, mass ratio and step.

    Args:
        iterations: Newton iterations a substep at most.
        tolerance: Stop when what is left of |C| and of the momentum balance, estimated from the step just made, is
            under it [m]; None: when it is under 4e-15 of the link's length (in float32: 1e-10), and what ends under
            1e-11 of it (1e-6) counts as converged.

    Raises:
        InputError: iterations < 1, tolerance <= 0; when bound to a simulation: a stiffness below 1.
    """

    name: ClassVar[str] = "direct"
    remedy: ClassVar[str] = ""
    keeps_forces: ClassVar[bool] = True

    iterations: int = 100
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
        model = context.model
        if np.any(model.distance.stiffness < 1.0) or np.any(model.point.stiffness < 1.0):
            raise InputError("method 'direct' solves exactly: soften with compliance instead of a stiffness below 1")
        edges, points = model.distance, model.point
        alone = np.full(model.particle_count, contacts is not None)
        alone[points.particle] = True
        self.schedule = s = schedule(edges.edge, model.w > 0.0, alone, model.bending.triple)
        self._device_schedule = pieces.Schedule()
        for field in fields(Schedule):
            if field.name != "link" and field.name != "tile":
                array = context.upload(f"direct.{field.name}", getattr(s, field.name), wp.int32)
                setattr(self._device_schedule, field.name, array)
        tiles, slots = len(s.particle), len(s.row)
        self._matrix = pieces.Matrix()
        for name, count, dtype in (
            *(("D", tiles, wp.mat33d), ("F", tiles, wp.mat33d), ("low", slots, wp.mat33d), ("up", slots, wp.mat33d)),
            *(("b", tiles, wp.vec3d), ("where", tiles, wp.int32)),
        ):
            setattr(self._matrix, name, context.allocate(f"direct.{name}", count, dtype))
        self._particles, self._links = pieces.Particles(), pieces.Links()
        self._bind_links(edges, s)
        self._points = pieces.Points()
        self._point_compliance = None
        if len(points):
            self._bind_points(points, s)
        self._touches = Touches(context, contacts, self._particles) if contacts else None
        touching = self._touches.contacts if self._touches else pieces.Touching()
        bends = bind_bends(context, model.bending, s, self._links)
        self._system = System(
            *(self._device_schedule, self._matrix, self._particles, self._links, self._points, touching, bends)
        )
        self._coupling: Coupling | None = None
        sources: list[ContactSource] = []
        if contacts and contacts.pairs:
            sources.append(PairSource(context, contacts))
        if contacts and contacts.links:
            sources.append(LinkSource(context, contacts, contacts.links))
        if sources:
            self._coupling = Coupling(context, sources, s, self._system)
        self._base = context.allocate("direct.base", model.particle_count, context.vec3)
        self._force_scale = context.allocate("direct.force_scale", 1, context.real)
        relative = TOLERANCE[model.dtype]
        close = COARSER * relative
        accepted = ACCEPTED[model.dtype] / relative, ACCEPTED_CONTACT[model.dtype] / close
        self._until = Tolerance(method.iterations, 0.0, relative, close, *accepted)
        if method.tolerance is not None:
            self._until = Tolerance(method.iterations, method.tolerance, 0.0, 0.0, 1.0, 1.0)
        self.counters = context.allocate("direct.counters", 2, wp.int32)

    def _bind_links(self, edges: DistanceSet, s: Schedule) -> None:
        context, model = self._context, self._context.model
        edge, rest = edges.edge[s.link], edges.rest_length[s.link]
        soft = edges.compliance[s.link] > 0.0
        upload = context.upload
        ends, lengths = upload("direct.edge", edge, wp.vec2i), upload("direct.rest_length", rest)
        self._lengths = LimitedLengths(context, "direct", ends, lengths, soft)
        self._compliance = None
        if soft.any():
            self._compliance = context.upload("direct.compliance", edges.compliance[s.link])
        tiles, count = len(s.particle), len(s.piece_first) - 1
        piece = np.repeat(np.arange(count), np.diff(s.piece_first))  # of each tile
        proximal = np.zeros(count)
        for k, (begin, end) in enumerate(pairwise(s.piece_first)):
            w = model.w[s.particle[begin:end]]
            proximal[k] = PROXIMAL / (np.sqrt(w.max() / w.min()) * max(1.0, (end - begin) / 300.0))
        proximal = np.maximum(proximal, ELASTIC / 10.0)
        p, links = self._particles, self._links
        p.give = context.upload("direct.give", proximal[piece] * model.w[s.particle], wp.float64)
        piece = np.repeat(piece, np.diff(s.link_first))  # of each link
        weight = model.w[edge].sum(axis=1)
        links.proximal = context.upload("direct.proximal", proximal[piece] * weight, wp.float64)
        rated = rest > 0.0
        number = np.maximum(np.bincount(piece, rated, count), 1)
        mean = np.bincount(piece, rest, count) / number
        p.mean_length = context.upload("direct.mean_length", mean, wp.float64)
        # A rubber band's compliance goes with its length.
        ratio = np.log(np.divide(weight, rest, out=np.ones_like(rest), where=rated))
        mean = np.exp(np.bincount(piece, np.where(rated, ratio, 0.0), count) / number)
        elastic = ELASTIC * np.where(rated, np.maximum(mean[piece] * rest, 0.01 * weight), weight)
        links.elastic = context.upload("direct.elastic", elastic, wp.float64)
        share = np.maximum(np.bincount(edges.edge.ravel(), minlength=model.particle_count) / 2.0, 1.0)
        softest = -SOFTEST / (model.w * share)[edge].max(axis=1) if len(edge) else rest
        links.softest = context.upload("direct.softest", softest, wp.float64)
        for group, name, size, dtype in (
            *(
                (p, "weight", tiles, wp.float64),
                (p, "mass", tiles, wp.float64),
                (p, "free", tiles, wp.vec3d),
                (p, "move", tiles, wp.vec3d),
            ),
            *((p, "shift", tiles, wp.vec3d), (p, "gives", count, wp.int32), (p, "strain", count, wp.float64)),
            (p, "missed", count, wp.int32),
            *(
                (links, "firm", len(edge), wp.float64),
                (links, "steadies", len(edge), wp.float64),
                (links, "fixed", len(edge), wp.vec4d),
            ),
            *((links, "before", len(edge), wp.vec3d), (links, "start", len(edge), wp.vec3d)),
            *(
                (links, "normal", len(edge), wp.vec3d),
                (links, "row", len(edge), wp.vec4d),
                (links, "lam", len(edge), wp.float64),
            ),
        ):
            setattr(
                group,
                name,
                context.allocate(f"direct.link.{name}" if group is links else f"direct.{name}", size, dtype),
            )
        if not rated.all():
            links.vector_lam = context.allocate("direct.vector_lam", len(edge), wp.vec3d)

    def _bind_points(self, points: PointSet, s: Schedule) -> None:
        context, p = self._context, self._points
        tile = s.tile[points.particle]
        some = np.flatnonzero(tile >= 0)
        which = some[np.argsort(tile[some], kind="stable")]
        first = np.concatenate([[0], np.cumsum(np.bincount(tile[some], minlength=len(s.particle)))])
        p.first = context.upload("direct.point_first", first, wp.int32)
        p.which = context.upload("direct.point", which, wp.int32)
        p.gone = context.allocate("direct.point_gone", len(points), wp.vec3d)
        p.soft = context.allocate("direct.point_soft", len(points), wp.float64)
        p.lam = context.allocate("direct.point_lam", len(points), wp.vec3d)
        if np.any(points.compliance > 0.0):
            self._point_compliance = context.upload("direct.point_compliance", points.compliance)

    def restart(self) -> None:
        """Forget the multipliers, which a step takes from the one before as a first guess."""
        for array in (self._links.lam, self._links.vector_lam, self._points.lam, self._particles.shift):
            if array:
                array.zero_()
        self._particles.gives.zero_()
        self._particles.missed.zero_()
        for part in (self._touches, self._coupling):
            if part:
                part.restart()

    def solve(self, stage: Stage) -> None:
        context, touches = self._context, self._touches
        context.launch.copy(self._base, context.u)
        context.launch.copy(self._force_scale, stage.compliance_scale)
        self._lengths.begin(stage)
        if touches:
            touches.begin(stage)
        model = (
            *(self._lengths.now, self._compliance, context.point_target, self._point_compliance),
            *(context.state.x, context.w),
        )
        coupling, until = self._coupling, self._until
        if coupling:
            coupling.begin(stage)
        context.launch(
            solve_pieces,
            len(self.schedule.piece_first) - 1,
            *(self._device_schedule, *model),
            *(self._base, stage.compliance_scale, stage.mean_gradient, stage.lam_scale, REACH),
            *(until.iterations, until.length, until.relative, until.close, until.accepted, until.accepted_contact),
            *(coupling.coupled if coupling else None, *self._system.parts),
            *(context.u, self.counters[0:1], self.counters[1:2]),
        )
        if coupling:
            coupling.solve(stage, model, self._base, REACH, until, self.counters)
        if touches:
            touches.note()

    def missed(self) -> np.ndarray:
        """How many solutions did not converge since the last restart, of the piece that a particle belongs to, int
        [particle_count]; 0 of fixed ones."""
        s = self.schedule
        out = np.zeros(self._context.model.particle_count, int)
        out[s.particle] = np.repeat(self._particles.missed.numpy(), np.diff(s.piece_first))
        return out

    def tension(self) -> np.ndarray:
        """Force along each distance in the last step [N], pull positive, float64 [edge_count]; 0 between fixed
        particles. Of a distance of rest length 0: its size."""
        out = np.zeros(len(self._context.model.distance))
        out[self.schedule.link] = -self._links.lam.numpy()
        if self._links.vector_lam:
            out[self.schedule.link] += np.linalg.norm(self._links.vector_lam.numpy(), axis=1)
        return out * self._newtons()

    def point_reaction(self) -> np.ndarray:
        """Force of each point constraint on its particle in the last step [N], float64 [point_count, 3]."""
        return self._points.lam.numpy() * self._newtons() if self._points.first else np.zeros((0, 3))

    def contact_force(self) -> np.ndarray:
        """Force of contacts on each particle in the last step, friction included [N], float64 [particle_count, 3]."""
        force = np.zeros((self._context.model.particle_count, 3))
        if self._touches:
            force += self._touches.force()
        if self._coupling:
            self._coupling.add_forces(force)
        return force * self._newtons()

    def _newtons(self) -> float:
        return float(self._force_scale.numpy()[0])
