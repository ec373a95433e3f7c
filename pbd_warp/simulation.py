"""The simulation: the loop of Mueller et al. 2007, Position Based Dynamics, section 3.1."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.constraints.distance import BoundDistances
from pbd_warp.constraints.point import BoundPoints
from pbd_warp.contacts import BoundContacts
from pbd_warp.damping import Damper
from pbd_warp.errors import InputError, SimulationFailed, unknown
from pbd_warp.integrators import INTEGRATORS, Integrator
from pbd_warp.launch import Launcher
from pbd_warp.methods import Jacobi, Method
from pbd_warp.model import Model, State

NOBODY = -1
FINITE = np.iinfo(np.int32).max
"""In `diverged`: no particle has left the finite numbers."""


class Simulation:
    """Runs a model, frame by frame.

    Args:
        model: What to simulate.
        dt: Length of a frame [s].
        substeps: Steps of the paper's loop in a frame, each of dt / substeps.
        method: How constraints are projected, `Jacobi()` unless given.
        integrator: How velocity becomes position and back: "pbd", "bdf2", "midpoint" or "midpoint4".
        damping: k of section 3.5: the fraction of all velocity that is not rigid motion taken away in a frame, 0..1.
        max_contacts: Room for contacts in one step; 8 a particle and 64 more unless given.
        capture: Record a frame once and replay it (a CUDA graph, or its CPU counterpart) instead of launching
            every kernel from Python.

    Attributes:
        state: Positions and velocities now; Warp arrays, which may be read and written between frames.
        point_target: Targets of the point constraints [m], Warp array [point_count], None where there are none; may be
            written between frames.
        iterations_used: Iterations of all steps of the last frame (with `Direct`, of all paths too).
        unconverged: Steps of the last frame (paths, with `Direct`) that ended above the method's tolerance; None where
            it has none.
        frame: Frames done. time: the same in seconds.
        compile_seconds: What loading (and at first use compiling) the kernels took.

    Raises:
        InputError: dt <= 0, substeps < 1, damping outside 0..1, max_contacts < 1, an unknown integrator.
    """

    def __init__(
        self,
        model: Model,
        dt: float = 1.0 / 60.0,
        substeps: int = 1,
        *,
        method: Method | None = None,
        integrator: str = "pbd",
        damping: float = 0.0,
        max_contacts: int | None = None,
        capture: bool = True,
    ):
        self.model = model
        self.dt = check.number("dt", dt, above=0.0)
        self.substeps = check.whole("substeps", substeps, low=1)
        self.method = method if method is not None else Jacobi()
        self.damping = check.number("damping", damping, low=0.0, high=1.0)
        self.max_contacts = None if max_contacts is None else check.whole("max_contacts", max_contacts, low=1)
        if integrator not in INTEGRATORS:
            raise unknown("integrator", integrator, INTEGRATORS)

        self.substep_dt = self.dt / self.substeps
        self.real, self.vec3 = model.real, model.vec3
        self._held: int | None = None
        self.launch = Launcher(model.device, model.real)
        self.arrays: dict[str, wp.array] = {}
        self.frame = 0

        self.state = State(x=self.upload("x", model.x, self.vec3), v=self.upload("v", model.v, self.vec3))
        self.w = self.upload("w", model.w)  # the grabbed particle's is 0 here, not in the model
        self.u = self.allocate("u", model.particle_count, self.vec3)
        self._iteration_counts: wp.array | None = None
        self.grabbed = self.upload("grabbed", [NOBODY], wp.int32)
        self.grab_target = self.allocate("grab_target", 1, self.vec3)
        self.diverged = self.upload("diverged", [FINITE], wp.int32)

        self._points: BoundPoints | None = None
        self.contacts = BoundContacts(self) if model.contacts or len(model.colliders.kind) else None
        self.valence = self.upload("valence", self.method.valence(model), wp.int32)
        # Contacts come and go, so the number of constraints that share a particle's mass does too.
        self.share = self.allocate("share", model.particle_count, wp.int32) if self.contacts else self.valence
        self.damper = Damper(self) if self.damping > 0.0 else None
        self.integrator: Integrator = INTEGRATORS[integrator](self)
        # Of the stage that is being launched: the integrator's, and (its length / that of the stage before)^2.
        self.per_force: wp.array = self.integrator.per_force(0)
        self.lam_scale = 1.0
        self.solver = self.method.bind(self)

        self.compile_seconds = self._load_kernels()
        self._graph = self._capture() if capture else None

    def step(self) -> None:
        """Advance by one frame.

        Raises:
            SimulationFailed: a position is no longer finite, or there were more contacts than room for them.
        """
        if self._graph is None:
            self._run_frame()
        else:
            wp.capture_launch(self._graph)
        self.frame += 1
        self._check_frame()

    def reset(self) -> None:
        """Back to the initial state: what comes then is what came the first time."""
        self.release()
        self.state.x.assign(self.model.x)
        self.state.v.assign(self.model.v)
        self.diverged.fill_(FINITE)
        if self._points:
            self._points.target.assign(self.model.point.target)
        if self.contacts:
            self.contacts.needed.zero_()
        self.integrator.restart()
        self.solver.restart()
        self.frame = 0

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.frame * self.dt

    @property
    def held(self) -> int | None:
        """The grabbed particle, None where there is none."""
        return self._held

    @property
    def point_target(self) -> wp.array | None:
        return self._points.target if self._points else None

    @property
    def iterations_used(self) -> int:
        if self._iteration_counts is None:
            return self.method.iterations * self.substeps * len(self.integrator.stages)
        return int(self._iteration_counts.numpy()[0])

    @property
    def unconverged(self) -> int | None:
        return None if self._iteration_counts is None else int(self._iteration_counts.numpy()[1])

    @property
    def passes(self) -> list[str]:
        """What one step (substep) launches, in order."""
        with self.launch.dry_run() as trace:
            self._run_step(remaining=1)
        return [name for name, _ in trace]

    def grab(self, particle: int) -> None:
        """Take hold of a particle: it stays where it is, whatever pulls at it, until `move_to` or `release`."""
        check.indices("grab", [particle], self.model.particle_count)
        self.release()
        self.grabbed.fill_(int(particle))
        self.w[particle : particle + 1].zero_()
        wp.copy(self.grab_target, self.state.x, src_offset=int(particle), count=1)
        self._held = int(particle)
        self.integrator.restart()

    def move_to(self, position: Any) -> None:
        """Where the grabbed particle is at the end of the next frame [m]; it gets there evenly over the substeps."""
        if self._held is None:
            raise InputError("move_to needs a grabbed particle: call grab(particle) first")
        self.grab_target.fill_(self.vec3(*check.vector("position", position)))

    def release(self) -> None:
        """Let go. A free particle keeps the velocity it was moved with; a fixed one stays where it is."""
        if self._held is None:
            return
        held = slice(self._held, self._held + 1)
        mass_inverse = float(self.model.w[self._held])
        self.w[held].fill_(mass_inverse)
        if mass_inverse == 0.0:
            self.state.v[held].zero_()
        self.grabbed.fill_(NOBODY)
        self._held = None
        self.integrator.restart()

    def _run_frame(self) -> None:
        if self._iteration_counts is not None:
            self.launch.zero(self._iteration_counts)
        for substep in range(self.substeps):
            self._run_step(remaining=self.substeps - substep)

    def _run_step(self, remaining: int) -> None:
        """One step of the integrator; `remaining` substeps are left in the frame, this one included."""
        stages = self.integrator.stages
        for number, stage in enumerate(stages):
            self.per_force = self.integrator.per_force(number)
            self.lam_scale = (stage / stages[number - 1]) ** 2  # before the first: the last, one step ago
            self._run_stage(stage * self.substep_dt, part=stage / (sum(stages[number:]) + remaining - 1))

    def _run_stage(self, dt: float, part: float) -> None:
        """One pass of the paper's loop, lines 5-16. The grabbed particle goes `part` of the way that it has left."""
        if self.damper:
            self.damper.accelerate_and_damp(dt)  # (5), (6)
        self.integrator.predict(dt, part)  # (5) where there is no line 6, (7)
        if self.contacts:
            self.contacts.find()  # (8)
        self.solver.solve()  # (9)-(11)
        self.integrator.update(dt)  # (12)-(15)
        if self.contacts:
            self.contacts.update_velocities()  # (16)

    def _load_kernels(self) -> float:
        with self.launch.dry_run() as trace:
            self._run_step(remaining=1)
        start = time.perf_counter()
        for module in {kernel.module.name for _, kernel in trace if kernel}:
            wp.load_module(module, device=self.model.device)
        return time.perf_counter() - start

    def _capture(self) -> wp.Graph:
        with wp.ScopedCapture(device=self.model.device, force_module_load=False) as capture:
            self._run_frame()
        return capture.graph

    def _check_frame(self) -> None:
        at = f"frame {self.frame} (t = {self.time:.6g} s)"
        particle = int(self.diverged.numpy()[0])
        if particle != FINITE:
            raise SimulationFailed(
                f"{at}: particle {particle} has left the finite numbers with {self.method} and "
                f"{self.substeps} substeps; {self.method.remedy}"
            )
        if self.contacts:
            needed = int(self.contacts.needed.numpy()[0])
            if needed:
                raise SimulationFailed(
                    f"{at}: {needed} contacts, but there is room for {self.contacts.capacity}; "
                    f"give Simulation or Scene max_contacts={2 * needed} or more"
                )

    def bind_constraints(self) -> list[BoundDistances | BoundPoints]:
        """The model's constraints on this device, for a method that takes them as they are."""
        edges, points = self.model.distance, self.model.point
        return ([edges.bind(self)] if len(edges) else []) + ([self.bind_points()] if len(points) else [])

    def bind_points(self) -> BoundPoints:
        """The model's point constraints on this device, whose targets are `point_target`."""
        self._points = self.model.point.bind(self)
        return self._points

    def count_iterations(self) -> tuple[wp.array, wp.array]:
        """The two counters behind `iterations_used` and `unconverged`, for a method whose iterations vary."""
        self._iteration_counts = self.allocate("iteration_counts", 2, wp.int32)
        return self._iteration_counts[0:1], self._iteration_counts[1:2]

    def upload(self, name: str, values: Any, dtype: Any = None) -> wp.array:
        """A device array of the simulation, by default in its precision; `name` is what the cost sheet calls it."""
        self.arrays[name] = wp.array(np.asarray(values), dtype=dtype or self.real, device=self.model.device)
        return self.arrays[name]

    def allocate(self, name: str, shape: int, dtype: Any) -> wp.array:
        """A device array of zeros."""
        self.arrays[name] = wp.zeros(shape, dtype=dtype, device=self.model.device)
        return self.arrays[name]
