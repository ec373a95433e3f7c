"""The simulation: the loop of Mueller et al. 2007, Position Based Dynamics, section 3.1."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from pbd_warp import check
from pbd_warp.errors import InputError, SimulationFailed, unknown
from pbd_warp.failure import Failure, describe
from pbd_warp.kernels.lead import lead, stop
from pbd_warp.model.model import Model, State
from pbd_warp.preflight import PreflightWarning, preflight
from pbd_warp.retry import ON_FAILURE, FrameRetry
from pbd_warp.step.constraints.contact import BoundContacts
from pbd_warp.step.constraints.distance import BoundDistances
from pbd_warp.step.constraints.point import BoundPoints
from pbd_warp.step.damping import Damper
from pbd_warp.step.divergence import NOTHING, DivergenceMonitor, Limits
from pbd_warp.step.integrators import INTEGRATORS, Integrator
from pbd_warp.step.launch import Launcher
from pbd_warp.step.methods import Direct, Jacobi, Method

NOBODY = -1


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
        depenetration_speed: What is wrong with a contact or a distance when a step begins is taken back no faster than
            this [m/s]: overlapping particles part, and a rope pulled too long and let go shrinks, at this speed a
            pair. None: at once, so that they leave with the depth of the error over the step's length.
        limits: Beyond which a frame counts as diverged.
        on_failure: What becomes of a frame that diverged, or in which `Direct` did not converge. "raise": the error.
            "subdivide": the frame is made again with twice the substeps, up to 16 times as many. "fallback": it is
            made again with integrator "bdf2", then "pbd". "continue": as "raise" when it diverged, but Newton
            iterations that did not converge are only counted.
        capture: Record a frame once and replay it (a CUDA graph, or its CPU counterpart) instead of launching
            every kernel from Python.

    Attributes:
        state: Positions and velocities now; Warp arrays, which may be read and written between frames.
        point_target: Targets of the point constraints [m], Warp array [point_count], None where there are none; may be
            written between frames.
        iterations_used: Iterations of all steps of the last frame (with `Direct`, of all paths too).
        unconverged: Steps of the last frame (paths, with `Direct`) that ended above the method's tolerance; None where
            it has none.
        held: The grabbed particle, None for none.
        frame: Frames done. time: the same in seconds.
        retried: Frames that "subdivide" or "fallback" made again with success.
        settings: The arguments, by name.
        compile_seconds: What loading (and at first use compiling) the kernels took.

    Raises:
        InputError: dt <= 0, substeps < 1, damping outside 0..1, max_contacts < 1, depenetration_speed <= 0, an unknown
            integrator or on_failure.
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
        depenetration_speed: float | None = None,
        limits: Limits = Limits(),  # noqa: B008 it is frozen
        on_failure: str = "raise",
        capture: bool = True,
    ):
        self.model = model
        self.dt = check.number("dt", dt, above=0.0)
        self.substeps = check.whole("substeps", substeps, low=1)
        self.method = method if method is not None else Jacobi()
        self.damping = check.number("damping", damping, low=0.0, high=1.0)
        self.max_contacts = None if max_contacts is None else check.whole("max_contacts", max_contacts, low=1)
        self.depenetration_speed = None
        if depenetration_speed is not None:
            self.depenetration_speed = check.number("depenetration_speed", depenetration_speed, above=0.0)
        if integrator not in INTEGRATORS:
            raise unknown("integrator", integrator, INTEGRATORS)
        if on_failure not in ON_FAILURE:
            raise unknown("on_failure", on_failure, ON_FAILURE)
        self.settings: dict[str, Any] = {
            "dt": self.dt,
            "substeps": self.substeps,
            "method": self.method,
            "integrator": integrator,
            "damping": self.damping,
            "max_contacts": self.max_contacts,
            "depenetration_speed": self.depenetration_speed,
            "limits": limits,
            "on_failure": on_failure,
            "capture": capture,
        }

        self.substep_dt = self.dt / self.substeps
        self.real, self.vec3 = model.real, model.vec3
        self.held: int | None = None
        self.led: tuple[int, list[int]] | None = None  # the frame that fixed particles are led in, and which
        self.launch = Launcher(model.device, model.real)
        self.arrays: dict[str, wp.array] = {}
        self.frame = 0
        self.retried = 0

        self.state = State(x=self.upload("x", model.x, self.vec3), v=self.upload("v", model.v, self.vec3))
        self.w = self.upload("w", model.w)  # the grabbed particle's is 0 here, not in the model
        self.u = self.allocate("u", model.particle_count, self.vec3)
        self._iteration_counts: wp.array | None = None
        self.grabbed = self.upload("grabbed", [NOBODY], wp.int32)
        self.grab_target = self.allocate("grab_target", 1, self.vec3)
        self.watch = DivergenceMonitor(self, limits)
        self.diverged = self.watch.diverged

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
        self.stage_dt = self.substep_dt
        self.solver = self.method.bind(self)
        # With contacts Newton's method is but one half of a round; no single one of them has to arrive.
        self._newton = isinstance(self.method, Direct) and not self.contacts and on_failure != "continue"
        self._recovery = FrameRetry(self, on_failure) if on_failure in ("subdivide", "fallback") else None

        self.compile_seconds = self._load_kernels()
        self._graph = self._capture() if capture else None

    def step(self) -> None:
        """Advance by one frame.

        Raises:
            SimulationFailed: the frame diverged, or `Direct` did not converge, and `on_failure` does not help; or there
                were more contacts than room for them.
        """
        if self.led is not None and self.led[0] != self.frame:
            self._stop_led()
        if self._graph is None:
            self._run_frame()
        else:
            wp.capture_launch(self._graph)
        self.frame += 1
        failure = self._failure()
        if failure is None:
            return
        if self._recovery is None or not self._recovery.retry():
            tried = f"; tried without success: {self._recovery.tried}" if self._recovery else ""
            error = SimulationFailed(describe(self, failure) + tried)
            self.watch.restart()  # the next frame, of a state that was put right, is judged by itself
            raise error
        self.retried += 1

    def reset(self) -> None:
        """Back to the initial state: what comes then is what came the first time."""
        self.release()
        self.state.x.assign(self.model.x)
        self.state.v.assign(self.model.v)
        if self._points:
            self._points.target.assign(self.model.point.target)
        self.led = None
        self.frame = self.retried = 0
        self._restart()

    def like(self, **changes: Any) -> Simulation:
        """Another simulation of the same model, in its initial state, with other settings (see `settings`)."""
        return Simulation(self.model, **{**self.settings, **changes})

    def take_over(self, other: Simulation, state: State | None = None) -> None:
        """Go on from where `other`, a simulation of the same model, is (or from a `state` of it): its frame, positions,
        velocities, grabbed particle and targets. Integrator and method begin anew."""
        for mine, theirs in (
            (self.state.x, (state or other.state).x),
            (self.state.v, (state or other.state).v),
            (self.w, other.w),
            (self.grabbed, other.grabbed),
            (self.grab_target, other.grab_target),
        ):
            wp.copy(mine, theirs)
        if self._points and other._points:
            wp.copy(self._points.target, other._points.target)
        if self._iteration_counts is not None and other._iteration_counts is not None:
            wp.copy(self._iteration_counts, other._iteration_counts)
        self.held, self.led = other.held, other.led
        self.frame = other.frame
        self._restart()

    def save(self, path: str | Path) -> None:
        """Write a checkpoint: see pbd_warp/checkpoint.py, which also says what it raises."""
        from pbd_warp.checkpoint import save  # which knows this class

        save(self, path)

    @classmethod
    def load(cls, path: str | Path, device: Any = None) -> Simulation:
        """The simulation that `save` wrote, model included; it goes on as if it had never stopped, bit for bit on the
        CPU. Raises InputError for a file that is not a whole checkpoint of this version."""
        from pbd_warp.checkpoint import load

        return load(path, device)

    def _restart(self) -> None:
        self.watch.restart()
        if self.contacts:
            self.contacts.needed.zero_()
        self.integrator.restart()
        self.solver.restart()

    def check(self) -> list[PreflightWarning]:
        """What is known to fail with these settings, worst first: each with its remedy, and with the name of its test,
        which is that of a map in the stability atlas. An estimate, from the graph and the state as they are now; an
        empty list is no promise. Reads the state back from the device."""
        return [caution for caution in preflight(self) if caution.severity > 1.0]

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.frame * self.dt

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

    @property
    def launches(self) -> int:
        """Launches in a frame: its steps, and the watch at its end."""
        with self.launch.dry_run() as trace:
            self._run_frame()
        return len(trace)

    def grab(self, particle: int) -> None:
        """Take hold of a particle: it stays where it is, whatever pulls at it, until `move_to` or `release`."""
        check.indices("grab", [particle], self.model.particle_count)
        self.release()
        self.grabbed.fill_(int(particle))
        self.w[particle : particle + 1].zero_()
        wp.copy(self.grab_target, self.state.x, src_offset=int(particle), count=1)
        self.held = int(particle)
        self.integrator.restart()

    def move_to(self, position: Any) -> None:
        """Where the grabbed particle is at the end of the next frame [m]; it gets there evenly over the substeps."""
        if self.held is None:
            raise InputError("move_to needs a grabbed particle: call grab(particle) first")
        self.grab_target.fill_(self.vec3(*check.vector("position", position)))

    def release(self) -> None:
        """Let go. A free particle keeps the velocity it was moved with; a fixed one stays where it is."""
        if self.held is None:
            return
        held = slice(self.held, self.held + 1)
        mass_inverse = float(self.model.w[self.held])
        self.w[held].fill_(mass_inverse)
        if mass_inverse == 0.0:
            self.state.v[held].zero_()
        self.grabbed.fill_(NOBODY)
        self.held = None
        self.integrator.restart()

    def lead(self, particles: Any, positions: Any) -> None:
        """Where fixed particles are at the end of the next frame; they get there evenly over the substeps, to
        round-off, and rest there unless they are led on.

        Args:
            particles: Indices, shape [n]. All that are led in the next frame: another call replaces this one.
            positions: [m], shape [n, 3].

        Raises:
            InputError: a particle that is not fixed (grab those), or not as many positions as particles.
        """
        index = np.atleast_1d(check.indices("lead", particles, self.model.particle_count))
        target = check.vectors("positions", positions)
        if len(target) != len(index):
            raise InputError(f"lead needs a position for each of {len(index)} particles, not {len(target)}")
        free = index[self.model.w[index] > 0.0]
        if free.size:
            raise InputError(f"lead takes fixed particles, but particle {free[0]} has mass: fix it (mass 0) or grab it")
        self._stop_led()
        self.led = (self.frame, index.tolist())
        device = self.model.device
        particle, there = wp.array(index, dtype=wp.int32, device=device), wp.array(target, self.vec3, device=device)
        self.launch(lead, len(index), self.state.x, particle, there, self.dt, self.state.v)

    def _stop_led(self) -> None:
        if self.led is not None:
            particle = wp.array(self.led[1], dtype=wp.int32, device=self.model.device)
            self.launch(stop, len(particle), particle, self.state.v)
            self.led = None

    def _run_frame(self) -> None:
        if self._recovery:
            self._recovery.remember()
        if self._iteration_counts is not None:
            self.launch.zero(self._iteration_counts)
        for substep in range(self.substeps):
            self._run_step(remaining=self.substeps - substep)
        self.watch.launch()

    def _run_step(self, remaining: int) -> None:
        """One step of the integrator; `remaining` substeps are left in the frame, this one included."""
        stages = self.integrator.stages
        for number, stage in enumerate(stages):
            self.per_force = self.integrator.per_force(number)
            self.lam_scale = (stage / stages[number - 1]) ** 2  # before the first: the last, one step ago
            self._run_stage(stage * self.substep_dt, part=stage / (sum(stages[number:]) + remaining - 1))

    def _run_stage(self, dt: float, part: float) -> None:
        """One pass of the paper's loop, lines 5-16. The grabbed particle goes `part` of the way that it has left."""
        self.stage_dt = dt
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
            self.watch.launch()
        start = time.perf_counter()
        for module in {kernel.module.name for _, kernel in trace if kernel}:
            wp.load_module(module, device=self.model.device)
        return time.perf_counter() - start

    def _capture(self) -> wp.Graph:
        with wp.ScopedCapture(device=self.model.device, force_module_load=False) as capture:
            self._run_frame()
        return capture.graph

    def _failure(self) -> Failure | None:
        """What is wrong with the frame just made, if anything."""
        if self.contacts:
            needed = int(self.contacts.needed.numpy()[0])
            if needed:
                self.contacts.needed.zero_()
                raise SimulationFailed(
                    f"frame {self.frame} (t = {self.time:.6g} s): {needed} contacts, but there is room for "
                    f"{self.contacts.capacity}; give Simulation or Scene max_contacts={2 * needed} or more"
                )
        particle, edge, energy = self.diverged.numpy().tolist()
        for kind, number in ("particle", particle), ("stretch", edge), ("energy", energy):
            if number != NOTHING:
                return kind, number
        if self._newton and self.unconverged:
            return "newton", self.unconverged
        return None

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
