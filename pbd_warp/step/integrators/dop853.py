"""Dormand and Prince's method of order 8 on accelerations, a whole frame in one launch (kernels/explicit.py)."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.kernels.explicit import make_frame
from pbd_warp.kernels.precision import BLOCK, PRECISIONS
from pbd_warp.model.model import Model, State
from pbd_warp.step.integrators.coefficients import DOP853, Tableau
from pbd_warp.step.integrators.pieces import Graph, Pieces
from pbd_warp.step.launch import Launcher

MOST_STEPS = 100_000
"""In a frame. A piece that needs more stays where it is and counts as failed."""

VANISHING = 64.0
"""A pivot under so many machine epsilons of its diagonal is that of a link that others determine already."""

NOTHING = int(np.iinfo(np.int32).max)
"""In `failed`: no piece."""


class ExplicitFrame:
    """Frames of a model by an explicit method.

    Args:
        model: What moves.
        dt: Of a frame [s].
        state: Positions and velocities, written by `step_frame`.
        w: Inverse masses, 0 of the grabbed particle too [particle_count].
        grabbed: [1], -1 for nobody. grab_target: [1], where it is at the end of the next frame [m].
        point_target: [point_count] [m], None without points.
        launch: Of the model's device and precision.
        substeps: Steps of equal length, or "auto": `error` chooses them, piece by piece.
        error: What "auto" keeps, metres a second of simulated time.
        tableau: The method.
    """

    def __init__(
        self,
        model: Model,
        dt: float,
        state: State,
        w: wp.array,
        grabbed: wp.array,
        grab_target: wp.array,
        point_target: wp.array | None,
        launch: Launcher,
        *,
        substeps: int | str = "auto",
        error: float = 1e-6,
        tableau: Tableau = DOP853,
    ):
        refuse(model)
        auto = substeps == "auto"
        self._error = check.number("error", error, above=0.0) if auto else 0.0
        self._longest = 1.0 if auto else 1.0 / check.whole("substeps", substeps, low=1)
        self._launch = launch
        real, vec3, device = model.real, model.vec3, model.device

        def upload(values: Any, dtype: type = real) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

        def scratch(count: int, dtype: type = real) -> wp.array:
            return wp.zeros(count, dtype=dtype, device=device)

        def by_blocks(array: wp.array) -> wp.array:
            """The same memory, which the argument list keeps alive."""
            count = array.size // int(BLOCK)
            return wp.array(ptr=array.ptr, dtype=PRECISIONS[real]["Block"], shape=count, device=device)

        distance = model.distance
        pieces = Pieces.of(model.particle_count, distance.edge)
        graph = Graph.of(pieces, distance)
        place_count = len(pieces.vertex)
        self._piece_count = len(pieces.is_path)
        compliance = None
        if np.any(distance.compliance[pieces.link[pieces.link >= 0]] > 0.0):
            compliance = upload(_along(distance.compliance, pieces.link, 0.0))
        point = None
        if len(model.point):
            at = np.full(model.particle_count + 1, -1)
            at[model.point.particle] = np.arange(len(model.point))
            point = upload(at[pieces.vertex], wp.int32)
        stages = len(tableau.b)
        links = len(graph.length)
        epsilon = float(np.finfo(model.dtype).eps)
        self.steps_used = scratch(self._piece_count, wp.int32)
        self.failed = wp.full(1, NOTHING, dtype=wp.int32, device=device)
        self._step = wp.full(self._piece_count, 1.0, dtype=real, device=device)
        v, u, v_next, error5, error3 = (scratch(place_count, vec3) for _ in range(5))
        k = scratch(place_count * stages, vec3)
        self._arguments = [
            vec3(*model.gravity), upload(pieces.first, wp.int32), upload(pieces.end, wp.int32),
            upload(pieces.vertex, wp.int32), point, point_target,
            upload(pieces.is_path, wp.int32), upload(_along(distance.rest_length, pieces.link, 1.0)), compliance,
            upload(graph.link_first, wp.int32), upload(graph.ends, wp.vec2i), upload(graph.length),
            *(upload(array, wp.int32) for array in graph.schedule),
            upload(graph.spring_first, wp.int32), upload(graph.spring_ends, wp.vec2i),
            upload(graph.spring_length), upload(graph.spring_compliance),
            stages, upload(tableau.c), upload(tableau.to_position.ravel()), upload(tableau.to_velocity.ravel()),
            upload(tableau.to_estimate.ravel()), self._error, self._longest, MOST_STEPS,
            16.0 * epsilon, VANISHING * epsilon,
            dt, w, grabbed, grab_target,
            state.x, state.v, self._step,
            scratch(place_count, vec3), v, scratch(place_count), u, v_next,
            scratch(place_count, vec3), scratch(place_count), scratch(place_count), error5, error3, k,
            *(by_blocks(array) for array in (v, u, v_next, error5, error3, k)),
            scratch(links, vec3), scratch(links), scratch(links), scratch(links, wp.int32), scratch(graph.slots),
            self.steps_used, self.failed,
        ]  # fmt: skip

    def step_frame(self) -> None:
        """One frame: one launch."""
        self._launch(make_frame, self._piece_count, *self._arguments)

    @property
    def substeps_used(self) -> int:
        """Steps of the last frame, those thrown away too, of the piece that took most."""
        return int(self.steps_used.numpy().max())

    def restart(self) -> None:
        """Forget the lengths of steps."""
        self._step.fill_(1.0)


def refuse(model: Model) -> None:
    """Raises an InputError for what the method has no equations for."""
    name = "integrator 'dop853'"
    distance, point = model.distance, model.point
    if model.contacts is not None or len(model.colliders.kind):
        raise InputError(f"{name} does not model contacts and colliders: use 'pbd' or 'bdf2', or leave them out")
    if np.any(distance.stiffness < 1.0) or np.any(point.stiffness < 1.0):
        raise InputError(f"{name} does not model stiffness below 1: soften distances with compliance instead")
    if np.any(point.compliance > 0.0):
        raise InputError(f"{name} does not model points with compliance: hold a particle by a distance with compliance")
    if np.any(distance.rest_length == 0.0):
        raise InputError(f"{name} needs rest lengths above 0: join coincident particles into one")
    twice = np.flatnonzero(np.bincount(point.particle) > 1)
    if twice.size:
        raise InputError(f"{name} takes one point constraint a particle, but particle {twice[0]} has more")


def _along(values: np.ndarray, link: np.ndarray, none: float) -> np.ndarray:
    return np.where(link >= 0, np.append(values, none)[link], none)
