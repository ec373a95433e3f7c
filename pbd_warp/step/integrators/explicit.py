"""Explicit Runge-Kutta methods on accelerations: a whole frame in one launch (kernels/explicit.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.kernels.explicit import make_frame
from pbd_warp.kernels.precision import BLOCK, PRECISIONS
from pbd_warp.model.model import Model
from pbd_warp.step.context import Context
from pbd_warp.step.integrators.coefficients import Tableau
from pbd_warp.step.integrators.pieces import Graph, Pieces

MOST_STEPS = 100_000
"""In a frame. A piece that needs more stays where it is and counts as failed."""

VANISHING = 64.0
"""A pivot under so many machine epsilons of its diagonal is that of a link that others determine already."""


class Explicit:
    """Makes frames of rigid distances, springs and points; no step of the paper's loop, and no method of it.

    Multipliers come from one linear solution a stage, along paths or on any graph; after each step positions go back
    onto the lengths, velocities onto their tangent. Each connected piece has a thread, and with `error` its own steps.
    Attributes:
        name, order, tableau: Of the method.
        estimates: Whether it has an embedded estimate of its error, by which `error` chooses the steps.
        stable: Largest product of step and angular frequency at which the swing of a spring does not grow.

    Args:
        context: What it is handed.
        dt: Length of a frame [s].
        error: What a step may be off, a second of its length [m/s]: the method's own estimate chooses the steps. None:
            all are `context.dt` long.

    Raises:
        InputError: bending, points with compliance, distances of no length, two points at one particle.

    Fails when: nothing satisfies the lengths, or the motion of a piece is too violent for its steps.
    """

    name: str
    order: int
    estimates: bool
    tableau: Tableau
    stable: float

    def __init__(self, context: Context, dt: float, error: float | None = None):
        model = context.model
        refuse(self.name, model)
        self._context = context
        vec3, real = context.vec3, context.real

        def upload(name: str, values: Any, dtype: type = real) -> wp.array:
            return context.upload(f"explicit.{name}", np.ascontiguousarray(values), dtype)

        def scratch(name: str, count: int, dtype: type = real) -> wp.array:
            return context.allocate(f"explicit.{name}", count, dtype)

        def by_blocks(array: wp.array) -> wp.array:
            """The same memory, which the context keeps alive."""
            count = array.size // int(BLOCK)
            return wp.array(ptr=array.ptr, dtype=PRECISIONS[real]["Block"], shape=count, device=model.device)

        distance, t = model.distance, self.tableau
        pieces = Pieces.of(model.particle_count, distance.edge)
        graph = Graph.of(pieces, distance)
        places, links, stages = len(pieces.vertex), len(graph.length), len(t.b)
        self._piece_count = len(pieces.is_path)
        compliance = point = None
        if np.any(distance.compliance[pieces.link[pieces.link >= 0]] > 0.0):
            compliance = upload("compliance", _along(distance.compliance, pieces.link, 0.0))
        if len(model.point):
            at = np.full(model.particle_count + 1, -1)
            at[model.point.particle] = np.arange(len(model.point))
            point = upload("point", at[pieces.vertex], wp.int32)
        epsilon = float(np.finfo(model.dtype).eps)
        self._step = upload("step", np.ones(self._piece_count))
        self._makes_many = self._piece_count == 1 and not np.any(distance.compliance > 0.0)
        self._frames = scratch("frames", 2, wp.int32)
        self._seen = self._frames.numpy() if model.device.is_cpu else None  # the memory itself
        self._used = scratch("steps_used", self._piece_count, wp.int32)
        v, u, v_next, error5, error3 = (
            scratch(name, places, vec3) for name in ("v", "u", "v_next", "error5", "error3")
        )
        k = scratch("k", places * stages, vec3)
        self._arguments = [
            context.gravity, upload("piece_first", pieces.first, wp.int32), upload("piece_end", pieces.end, wp.int32),
            upload("vertex", pieces.vertex, wp.int32), point, context.point_target,
            upload("path", pieces.is_path, wp.int32),
            upload("rest_length", _along(distance.rest_length, pieces.link, 1.0)), compliance,
            upload("link_first", graph.link_first, wp.int32), upload("ends", graph.ends, wp.vec2i),
            upload("length", graph.length),
            *(upload(f"schedule.{name}", array, wp.int32) for name, array in graph.schedule.items()),
            upload("spring_first", graph.spring_first, wp.int32), upload("spring_ends", graph.spring_ends, wp.vec2i),
            upload("spring_length", graph.spring_length), upload("spring_compliance", graph.spring_compliance),
            stages, upload("stage_time", [*t.c, 1.0]), upload("to_position", t.to_position.ravel()),
            upload("to_velocity", t.to_velocity.ravel()), upload("to_estimate", t.to_estimate.ravel()),
            error or 0.0, 1.0 if error else context.dt / dt, MOST_STEPS, 16.0 * epsilon, VANISHING * epsilon,
            dt, context.w, context.state.x, context.state.v, self._step,
            scratch("x", places, vec3), v, scratch("w", places), u, v_next,
            scratch("direction", places, vec3), scratch("lower", places), scratch("y", places), error5, error3, k,
            *(by_blocks(array) for array in (v, u, v_next, error5, error3, k)),
            scratch("link_direction", links, vec3), scratch("link_inverse", links), scratch("link_y", links),
            scratch("where", links, wp.int32), scratch("factor", len(graph.schedule["row"])),
            self._frames, self._used, context.diverged,
        ]  # fmt: skip

    def make_frame(self) -> None:
        """One launch."""
        self._context.launch(make_frame, self._piece_count, *self._arguments)

    @property
    def makes_many(self) -> bool:
        """Whether one launch can make several frames, and stops at one that fails: pieces do not wait for each other,
        and springs may stretch beyond a limit that is looked at after the launch."""
        return self._makes_many

    def want(self, frames: int) -> None:
        """How many frames a launch makes."""
        if self._seen is None:
            self._frames[:1].fill_(frames)
        else:
            self._seen[0] = frames

    @property
    def made(self) -> int:
        """How many frames the last launch made."""
        return int((self._frames.numpy() if self._seen is None else self._seen)[1])

    @property
    def steps_used(self) -> np.ndarray:
        """Steps of the last frame, those thrown away too, of each piece, int32 [piece_count]."""
        return self._used.numpy()

    def restart(self) -> None:
        """Forget the lengths of steps."""
        self._step.fill_(1.0)


def refuse(integrator: str, model: Model) -> None:
    """Raises an InputError for what explicit methods have no equations for."""
    name = f"integrator {integrator!r}"
    distance, point = model.distance, model.point
    if len(model.bending):
        raise InputError(f"{name} does not model bending: leave it out, or use method 'direct' with another integrator")
    if np.any(point.compliance > 0.0):
        raise InputError(f"{name} does not model points with compliance: hold a particle by a distance with compliance")
    if np.any(distance.rest_length == 0.0):
        raise InputError(f"{name} needs rest lengths above 0: join coincident particles into one")
    twice = np.flatnonzero(np.bincount(point.particle) > 1)
    if twice.size:
        raise InputError(f"{name} takes one point constraint a particle, but particle {twice[0]} has more")


def _along(values: np.ndarray, link: np.ndarray, none: float) -> np.ndarray:
    return np.where(link >= 0, np.append(values, none)[link], none)
