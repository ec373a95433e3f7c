"""The loop of Mueller et al. 2007, Position Based Dynamics, section 3.1, on a model's device."""

from __future__ import annotations

import time
from typing import Any

import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.failure import Failure
from pbd_warp.model.model import Model, State
from pbd_warp.settings import Settings
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.context import NOTHING, Context, Stage
from pbd_warp.step.copies import CopyMonitor
from pbd_warp.step.damping import Damper
from pbd_warp.step.divergence import DivergenceMonitor
from pbd_warp.step.integrators import DOP853, EXPLICIT, INTEGRATORS, Integrator
from pbd_warp.step.integrators.second_order import refuse_first_order_features
from pbd_warp.step.loading import load_modules
from pbd_warp.step.methods import Direct
from pbd_warp.step.pull import Pull


class Loop:
    """Makes frames of a model. A part that the model has no use for is not there: nothing of it is launched.

    Attributes:
        context: The arrays that its parts share.
        explicit: What makes frames instead of the loop; None where the loop does.
        start: The state at the start of the frame, where a failed one can be made again.
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
        self.context = context = Context(model, settings.step_dt, settings.depenetration_speed)
        self.contacts = None
        if model.collides:
            self.contacts = ContactConstraints(context, settings.method.valence(model), settings.max_contacts)
        self.damper = Damper(context, settings.damping, settings.steps_a_frame) if settings.damping > 0.0 else None
        self.explicit: DOP853 | None = None
        self.integrator: Integrator | None = None
        self.solver: Any = None
        self.pull: Pull | None = None
        if name in EXPLICIT:
            self.explicit = EXPLICIT[name](context, settings.dt, settings.error if settings.auto else None)
        else:
            self.integrator = INTEGRATORS[name](context, damped=self.damper is not None)
            self.solver = settings.method.bind(context, self.contacts)
            if settings.grab_acceleration is not None:
                self.pull = Pull(context, settings.grab_acceleration, settings.grab_speed)
        monitor = DivergenceMonitor if model.copy_count == 1 else CopyMonitor
        self.monitor: DivergenceMonitor | CopyMonitor = monitor(context, settings.limits)
        self.start: State | None = None
        if settings.on_failure in ("subdivide", "fallback"):
            n = model.particle_count
            self.start = State(*(context.allocate(f"start.{name}", n, context.vec3) for name in "xv"))
        # With contacts Newton's method is but one half of a round; no single one of them has to arrive.
        self._newton = isinstance(settings.method, Direct) and not self.contacts and settings.on_failure != "continue"
        self.compile_seconds = self._load_kernels()
        self._graph = self._capture() if settings.capture else None

    def make_frame(self) -> None:
        """Advance the state by a frame."""
        if self._graph is None:
            self.run_frame()
        else:
            wp.capture_launch(self._graph)

    def run_frame(self) -> None:
        """Launch the steps of a frame, and the search for divergence at its end."""
        context = self.context
        if self.start:
            context.launch.copy(self.start.x, context.state.x)
            context.launch.copy(self.start.v, context.state.v)
        if self.counters is not None:
            context.launch.zero(self.counters)
        for _ in range(1 if self.explicit else self._settings.steps_a_frame):
            self.run_step()
        self.monitor.launch()

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
        if self.contacts:
            needed = int(self.contacts.needed.numpy()[0])
            if needed:
                self.contacts.needed.zero_()
                return "contacts", needed
        if isinstance(self.monitor, DivergenceMonitor):
            particle, edge, energy, piece = self.context.diverged.numpy().tolist()
            for kind, number in ("particle", particle), ("piece", piece), ("stretch", edge), ("energy", energy):
                if number != NOTHING:
                    return kind, number
        if self._newton and self.unconverged:
            return "newton", self.unconverged
        return None

    def find_failed_copies(self) -> dict[int, Failure]:
        """What is wrong with each copy that has failed in the frame just made; none where there are no copies."""
        return self.monitor.find() if isinstance(self.monitor, CopyMonitor) else {}

    def lay_to_rest(self, copies: list[int]) -> None:
        """These copies take no more part."""
        assert isinstance(self.monitor, CopyMonitor)
        self.monitor.lay_to_rest(copies)

    @property
    def unconverged(self) -> int | None:
        """Steps of the last frame (paths, with `Direct`) that ended above the method's tolerance; None without one."""
        return None if self.counters is None else int(self.counters.numpy()[1])

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
        if self.contacts:
            self.contacts.needed.zero_()
        for part in (self.integrator, self.solver, self.explicit):
            if part:
                part.restart()

    def _load_kernels(self) -> float:
        with self.context.launch.dry_run() as trace:
            self.run_step()
            self.monitor.launch()
        start = time.perf_counter()
        load_modules({kernel.module.name for _, kernel in trace if kernel}, self.context.model.device)
        return time.perf_counter() - start

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
