"""The loop of Mueller et al. 2007, Position Based Dynamics, section 3.1, on a model's device."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.failure import Failure
from pbd_warp.model.model import Model, State
from pbd_warp.settings import Settings
from pbd_warp.step.colliders import ColliderShapes
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.context import NOTHING, Context, Stage
from pbd_warp.step.copies import CopyMonitor
from pbd_warp.step.damping import Damper
from pbd_warp.step.divergence import DivergenceMonitor
from pbd_warp.step.integrators import EXPLICIT, INTEGRATORS, Explicit, Integrator
from pbd_warp.step.integrators.second_order import refuse_first_order_features, refuse_forces
from pbd_warp.step.loading import load_modules
from pbd_warp.step.methods import Direct
from pbd_warp.step.methods.direct import DirectSolver
from pbd_warp.step.program import Machine
from pbd_warp.step.pull import Pull


class Loop:
    """Makes frames of a model. A part that the model has no use for is not there: nothing of it is launched.

    Attributes:
        context: The arrays that its parts share.
        explicit: What makes frames instead of the loop; None where the loop does.
        start: The state at the start of the frame, where a failed one can be made again.
        machine: Makes frames in one launch; None where they are launched pass by pass, or replayed so.
        compile_seconds: What loading (and at first use compiling) the kernels took.

    Raises:
        InputError: what method or integrator refuse for this model.
    """

    def __init__(self, model: Model, settings: Settings):
        self._settings = settings
        _refuse_copies(model, settings)
        name = settings.integrator
        if name in EXPLICIT or INTEGRATORS[name].order > 1:
            refuse_first_order_features(settings.integrator, model, settings.damping, settings.depenetration_speed)
        if name in EXPLICIT:
            refuse_forces(name, model, settings.drag)
        self.context = context = Context(model, settings.step_dt, settings.depenetration_speed, settings.drag)
        self.contacts = None
        if model.collides:
            self.contacts = ContactConstraints(context, settings.method.valence(model), settings.max_contacts)
        self.damper = Damper(context, settings.damping, settings.steps_a_frame) if settings.damping > 0.0 else None
        self.explicit: Explicit | None = None
        self.integrator: Integrator | None = None
        self.solver: Any = None
        self.pull: Pull | None = None
        if name in EXPLICIT:
            self.explicit = EXPLICIT[name](context, settings.dt, settings.error if settings.auto else None)
        else:
            self.integrator = INTEGRATORS[name](context, damped=self.damper is not None)
            self.solver = settings.method.bind(context, self.contacts)
            if settings.grab_acceleration is not None:
                bounds = settings.grab_acceleration, settings.grab_speed
                self.pull = Pull(context, settings.dt, *bounds, fixed=not isinstance(settings.method, Direct))
        monitor = DivergenceMonitor if model.copy_count == 1 else CopyMonitor
        self.monitor: DivergenceMonitor | CopyMonitor = monitor(context, settings.limits)
        self.start: State | None = None
        if settings.on_failure in ("subdivide", "fallback"):
            n = model.particle_count
            self.start = State(*(context.allocate(f"start.{name}", n, context.vec3) for name in "xv"))
            if self.shapes:
                self.shapes.keep_start()
        self._newton = isinstance(settings.method, Direct) and settings.on_failure != "continue"
        self._seen = context.diverged.numpy() if model.device.is_cpu else None  # the memory itself
        self._graph: wp.Graph | None = None
        self.machine = self._compile() if settings.capture else None
        if self.machine is None:
            self.compile_seconds = self._load_kernels()
            self._graph = self._capture() if settings.capture else None

    @property
    def shapes(self) -> ColliderShapes | None:
        """The colliders; None where nothing collides."""
        return self.contacts.colliders if self.contacts else None

    def make_frames(self, frames: int) -> int:
        """Advance the state by so many frames, or up to one that fails, or by one; how many were made."""
        if self.machine is not None:
            return self.machine.make(frames)
        explicit = self.explicit
        # A limit on energy is looked at after each frame, and one to be made again needs its own start.
        many = explicit and explicit.makes_many and self.monitor.energy_limit is None and self.start is None
        if explicit:
            explicit.want(frames if many else 1)
        if self._graph is None:
            self.run_frame()
        else:
            wp.capture_launch(self._graph)
        return explicit.made if explicit and many else 1

    def run_frame(self) -> None:
        """Launch the steps of a frame, and the search for divergence at its end."""
        self._begin_frame()
        for _ in range(self._repetitions):
            self.run_step()
        self.monitor.launch()

    @property
    def _repetitions(self) -> int:
        """Of `run_step` in a frame."""
        return 1 if self.explicit else self._settings.steps_a_frame

    def _begin_frame(self) -> None:
        context = self.context
        if self.start:
            context.launch.copy(self.start.x, context.state.x)
            context.launch.copy(self.start.v, context.state.v)
            if self.shapes:
                self.shapes.begin_frame()
        if self.counters is not None:
            context.launch.zero(self.counters)

    def run_step(self) -> None:
        """One step of the integrator; all of a frame, where it is explicit."""
        if self.explicit:
            self.explicit.make_frame()
            return
        assert self.integrator
        if self.pull:
            self.pull.launch()
        for stage in self.integrator.stages:
            self._run_stage(stage)

    def _run_stage(self, stage: Stage) -> None:
        """One pass of the paper's loop, lines 5-16."""
        assert self.integrator
        if self.damper:
            self.damper.accelerate_and_damp(stage)  # (5), (6)
        self.integrator.predict(stage)  # (5) where there is no line 6, (7)
        if self.contacts:
            self.contacts.find()  # (8)
        self.solver.solve(stage)  # (9)-(11)
        self.integrator.update(stage)  # (12)-(15)
        if self.contacts:
            self.contacts.update_velocities()  # (16)

    def find_failure(self) -> Failure | None:
        """What is wrong with the frame just made, if anything; reads a few integers back."""
        seen = self.context.diverged.numpy() if self._seen is None else self._seen
        particle, edge, energy, piece, contacts = seen.tolist()
        if contacts:
            self.context.diverged[4:].zero_()
            return "contacts", contacts
        missed = self.unconverged if self._newton else None
        if isinstance(self.monitor, CopyMonitor):
            return ("copies", 0) if missed or self.monitor.found_any(seen) else None
        for kind, number in ("particle", particle), ("piece", piece), ("stretch", edge), ("energy", energy):
            if number != NOTHING:
                return kind, number
        return ("newton", missed) if missed else None

    def find_failed_copies(self) -> dict[int, Failure]:
        """What is wrong with each copy that has failed in the frame just made, which is then forgotten."""
        assert isinstance(self.monitor, CopyMonitor)
        return self.monitor.find(self.solver if self._newton else None)

    def lay_to_rest(self, copies: list[int]) -> None:
        """These copies take no more part."""
        assert isinstance(self.monitor, CopyMonitor)
        self.monitor.lay_to_rest(copies)

    @property
    def unconverged(self) -> int | None:
        """Steps of the last frame (paths, with `Direct`) that ended above the method's tolerance; None without one."""
        return None if self.counters is None else int(self.counters.numpy()[1])

    @property
    def missed(self) -> np.ndarray:
        """With `Direct`: see `DirectSolver.missed`; else all 0."""
        if isinstance(self.solver, DirectSolver):
            return self.solver.missed()
        return np.zeros(self.context.model.particle_count, int)

    @property
    def iterations_used(self) -> int:
        """Of the method, in all steps of the last frame; none of an explicit integrator."""
        if self.counters is not None:
            return int(self.counters.numpy()[0])
        if self.integrator is None:
            return 0
        return self._settings.method.iterations * self._settings.steps_a_frame * len(self.integrator.stages)

    @property
    def steps_used(self) -> int:
        """Steps of the last frame, of the piece that took most."""
        return int(self.explicit.steps_used.max()) if self.explicit else self._settings.steps_a_frame

    @property
    def counters(self) -> wp.array | None:
        """Iterations of the frame and solutions that did not converge, int32 [2]; None without a tolerance."""
        return self.solver.counters if self.solver else None

    def forget_steps(self) -> None:
        """What is held has changed: integrators that look back begin anew."""
        if self.integrator:
            self.integrator.restart()

    def restart(self) -> None:
        """Forget the past: the state has been put somewhere else."""
        self.monitor.restart()
        for part in (self.integrator, self.solver, self.explicit, self.contacts):
            if part:
                part.restart()

    def _load_kernels(self) -> float:
        with self.context.launch.dry_run() as trace:
            self.run_step()
            self.monitor.launch()
        start = time.perf_counter()
        load_modules({kernel.module.name for _, kernel in trace if kernel}, self.context.model.device)
        return time.perf_counter() - start

    def _compile(self) -> Machine | None:
        """What makes frames in one launch; None where that does not pay or a part cannot do it."""
        with self.context.launch.record() as program:
            self._begin_frame()
            with program.repeat(self._repetitions):
                self.run_step()
            self.monitor.launch()
        if program.machine is None or not program.pays(self.context.model.particle_count):
            return None
        start = time.perf_counter()
        machine = program.compile(self.context.diverged)
        self.compile_seconds = time.perf_counter() - start
        return machine

    def _capture(self) -> wp.Graph:
        with wp.ScopedCapture(device=self.context.model.device, force_module_load=False) as capture:
            self.run_frame()
        return capture.graph


def _refuse_copies(model: Model, settings: Settings) -> None:
    if model.copy_count == 1:
        return
    if settings.on_failure in ("subdivide", "fallback"):
        raise InputError(f"on_failure={settings.on_failure!r} would make all copies of a model again: use 'raise'")
    if settings.integrator in EXPLICIT:
        raise InputError(f"integrator {settings.integrator!r} takes no copies of a model: simulate them one by one")
