"""A step written down, so that one launch makes whole frames of it; kernels/machine.py walks it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from pbd_warp.kernels import (
    bdf2,
    bending,
    bounce,
    collider,
    contact,
    copies,
    damping,
    distance,
    divergence,
    integrate,
    iteration,
    jacobi,
    machine,
    memory,
    midpoint,
    point,
    pull,
    shape_contact,
)
from pbd_warp.kernels.precision import PrecisionKernel, StepPass
from pbd_warp.step.loading import load_modules

LANES = 256
"""Threads of the block that makes a frame on a GPU."""

ONE_BLOCK = 2048
"""Particles up to which a GPU makes a frame in one block. An estimate, 8 a thread: not measured."""

BASE = (
    *(memory.zero, memory.copy, pull.pull),
    *(distance.project_distance, point.project_point, jacobi.add_corrections, divergence.check_stretch),
)
FIRST_ORDER = (
    *(integrate.accelerate, integrate.predict, integrate.update),
    *(damping.sum_momentum, damping.divide_by_mass, damping.sum_angular_momentum),
    *(damping.find_rotation, damping.damp_velocities),
)
SECOND_ORDER = (
    *(bdf2.predict_bdf2, bdf2.update_bdf2, bdf2.remember, midpoint.predict_midpoint, midpoint.update_midpoint),
)
SELDOM = (
    *(iteration.begin_iterations, iteration.end_iteration, jacobi.add_corrections_accelerated, distance.limit_lengths),
    *(divergence.sum_energy, divergence.check_energy, copies.check_copies),
)
CONTACTS = (
    *(contact.find_close_contacts, collider.find_collider_contacts, contact.note_overflow, contact.project_contact),
    *(bounce.count_active, bounce.bounce),
)
SHAPES = (shape_contact.find_shape_contacts, shape_contact.move_shapes)
BENDING = (bending.project_bending,)
MACHINES = {
    "first_order": BASE + FIRST_ORDER,
    "second_order": BASE + SECOND_ORDER,
    "first_order_seldom": BASE + FIRST_ORDER + SELDOM,
    "second_order_seldom": BASE + SECOND_ORDER + SELDOM,
    "bending": BASE + FIRST_ORDER + SECOND_ORDER + SELDOM + BENDING,
    "contacts": BASE + FIRST_ORDER + CONTACTS,
    "contacts_seldom": BASE + FIRST_ORDER + CONTACTS + SELDOM,
    "shapes": BASE + FIRST_ORDER + CONTACTS + SHAPES,
    "shapes_seldom": BASE + FIRST_ORDER + CONTACTS + SHAPES + SELDOM,
}
"""Passes of each machine, the smaller ones first: what a scene does not use need not be compiled for it."""


@cache
def load_machine(name: str, real: type) -> tuple[wp.Kernel, tuple[Any, ...]]:
    """The kernel of a machine and the argument structs of its passes."""
    structs = tuple(machine.arguments_of(step_pass, real) for step_pass in MACHINES[name])
    return machine.build(name, MACHINES[name], structs, real), structs


class Program:
    """Operations of a frame in the order in which they were launched.

    Attributes:
        obstacle: What of it no machine can do, None where all can be done.
    """

    def __init__(self, device: wp.Device, real: type):
        self._device, self._real = device, real
        self._operations: list[tuple[StepPass | int, int, int, int]] = []
        self._arguments: dict[StepPass, dict[Any, tuple[int, Sequence[Any]]]] = {}
        self._condition: wp.array | None = None
        self.obstacle: str | None = None

    def add(self, kernel: PrecisionKernel, dim: int, arguments: Sequence[Any]) -> None:
        """A pass over `dim` indices."""
        if not isinstance(kernel, StepPass):
            self.obstacle = kernel.name
            return
        known = self._arguments.setdefault(kernel, {})
        key = tuple((a.ptr, a.shape) if isinstance(a, wp.array) else repr(a) for a in arguments)
        which, _ = known.setdefault(key, (len(known), arguments))
        self._operations.append((kernel, which, dim, 0))

    @contextmanager
    def loop(self, condition: wp.array) -> Iterator[None]:
        """What is added within it is done while condition[0] is not 0."""
        if self._condition is not None and self._condition.ptr != condition.ptr:
            self.obstacle = "a second condition"
        self._condition = condition
        head = len(self._operations)
        self._operations.append((machine.WHILE, 0, 0, 0))
        yield
        self._operations.append((machine.BACK, 0, 0, head))
        self._operations[head] = (machine.WHILE, 0, 0, len(self._operations))

    @contextmanager
    def repeat(self, times: int) -> Iterator[None]:
        """What is added within it is done so many times."""
        head = len(self._operations)
        yield
        self._operations.append((machine.STEP, 0, times, head))

    @property
    def machine(self) -> str | None:
        """The smallest machine that has all passes, None where none does or there is an obstacle."""
        used = set(self._arguments)
        fits = (name for name, passes in MACHINES.items() if used <= set(passes))
        return next(fits, None) if self.obstacle is None else None

    @property
    def passes(self) -> int:
        """How many are written down."""
        return len(self._operations)

    def pays(self, particle_count: int) -> bool:
        """Whether one thread (on a GPU: one block) is as fast as a launch a pass."""
        return self._device.is_cpu or particle_count <= ONE_BLOCK

    def compile(self, diverged: wp.array) -> Machine:
        """What makes frames of it; `diverged` stops it."""
        name = self.machine
        assert name is not None
        kernel, structs = load_machine(name, self._real)
        passes = MACHINES[name]
        operations = [
            (passes.index(op[0]) if isinstance(op[0], StepPass) else op[0], *op[1:])
            for op in [*self._operations, (machine.FRAME, 0, 0, 0)]
        ]
        arrays = [
            self._fill(struct, step_pass, list(self._arguments.get(step_pass, {}).values()))
            for step_pass, struct in zip(passes, structs, strict=True)
        ]
        program = wp.array(np.array(operations, np.int32), dtype=wp.vec4i, device=self._device)
        condition = self._condition
        if condition is None:
            condition = wp.zeros(1, dtype=wp.int32, device=self._device)
        return Machine(kernel, program, condition, diverged, arrays, keep=self._arguments)

    def _fill(self, struct: Any, step_pass: StepPass, entries: list[tuple[int, Sequence[Any]]]) -> wp.array:
        """The array of a pass's arguments; `entries` are in the order of their places."""
        instances = []
        for _, arguments in entries:
            instance = struct()
            for name, value in zip(step_pass.arguments[self._real], arguments, strict=True):
                setattr(instance, name, value)
            instances.append(instance)
        if not instances:
            return wp.empty(0, dtype=struct, device=self._device)
        return wp.array(instances, dtype=struct, device=self._device)


class Machine:
    """Makes frames in one launch, which is captured: `make(frames)` gives how many it made."""

    def __init__(
        self,
        kernel: wp.Kernel,
        program: wp.array,
        condition: wp.array,
        diverged: wp.array,
        arguments: list[wp.array],
        keep: Any,
    ):
        device = program.device
        self._keep = (keep, program, condition, arguments)
        self._control = wp.zeros(2, dtype=wp.int32, device=device)
        self._view = self._control.numpy() if device.is_cpu else None
        lanes = 1 if device.is_cpu else LANES
        load_modules([kernel.module.name], device)
        with wp.ScopedCapture(device=device, force_module_load=False) as capture:
            wp.launch(
                kernel,
                dim=lanes,
                inputs=[program, condition, diverged, self._control, *arguments],
                device=device,
                block_dim=lanes,
            )
        self._graph = capture.graph

    def make(self, frames: int) -> int:
        """Make so many frames, fewer where one fails: then it is the last."""
        if self._view is None:
            self._control.assign(np.array([frames, 0], np.int32))
            wp.capture_launch(self._graph)
            return int(self._control.numpy()[1])
        self._view[0] = frames
        wp.capture_launch(self._graph)
        return int(self._view[1])
