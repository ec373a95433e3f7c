"""The one door through which a step reaches the device: every launch, fill, copy and grid build goes through it,
so that a dry run can list them (`Simulation.passes`) without touching any data, and a frame be written down as a
program."""

from __future__ import annotations

import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import warp as wp

from pbd_warp.kernels.memory import copy, zero
from pbd_warp.kernels.precision import PrecisionKernel
from pbd_warp.step.program import Program

RECORDING = threading.RLock()
"""Held while a frame is recorded: Warp would record what other threads launch meanwhile along with it."""

Class = TypeVar("Class", bound=type)


def not_while_recording(*names: str) -> Callable[[Class], Class]:
    """Class decorator: methods, by name, that wait while another thread records a frame."""

    def guard(method: Callable[..., Any]) -> Callable[..., Any]:
        @functools.wraps(method)
        def guarded(*args: Any, **kwargs: Any) -> Any:
            with RECORDING:
                return method(*args, **kwargs)

        return guarded

    def decorate(decorated: Class) -> Class:
        for name in names:
            setattr(decorated, name, guard(getattr(decorated, name)))
        return decorated

    return decorate


@not_while_recording("__call__", "zero", "copy", "build_grid", "loop")
class Launcher:
    """Launches kernels in one precision on one device."""

    def __init__(self, device: wp.Device, real: type):
        self._device = device
        self._real = real
        self._trace: list[tuple[str, wp.Kernel | None]] | None = None
        self._program: Program | None = None
        self._nothing: dict[type, wp.array] = {}

    def __call__(self, kernel: PrecisionKernel, dim: int, *args: Any) -> None:
        """Launch `kernel` over `dim` threads; nothing at all where dim is 0."""
        instance = kernel[self._real]
        if dim == 0 or self._noted(kernel.name, instance):
            return
        inputs = [
            self._absent(parameter.type.dtype) if arg is None else arg
            for arg, parameter in zip(args, instance.adj.args, strict=True)
        ]
        if self._program is not None:
            self._program.add(kernel, dim, inputs)
        else:
            wp.launch(instance, dim=dim, inputs=inputs, device=self._device)

    def _absent(self, dtype: type) -> wp.array:
        """An array that is not there: false in a kernel, like None, but with an ordinary stride. On the CPU a single
        odd stride among a kernel's arrays makes Warp take a slower path for all of them (step.py in benchmarks: from
        1.4 to 2.0 times the C loop)."""
        if dtype not in self._nothing:
            self._nothing[dtype] = wp.empty(0, dtype=dtype, device=self._device)
        return self._nothing[dtype]

    def zero(self, array: wp.array) -> None:
        if self._noted("zero"):
            return
        if self._program is not None:
            words = _words(array)
            self._program.add(zero, len(words), [words])
        else:
            array.zero_()

    def copy(self, target: wp.array, source: wp.array) -> None:
        if self._noted("copy"):
            return
        if self._program is not None:
            words = _words(target)
            self._program.add(copy, len(words), [_words(source), words])
        else:
            wp.copy(target, source)

    def build_grid(self, grid: wp.HashGrid, points: wp.array, cell_width: float) -> None:
        if self._noted("HashGrid.build"):
            return
        if self._program is not None:
            self._program.obstacle = "HashGrid.build"
        else:
            grid.build(points, cell_width)

    def loop(self, condition: wp.array, body: Callable[[], None]) -> None:
        """Run `body` while condition[0] is not 0, decided on the device."""
        if self._noted("while"):
            body()
        elif self._program is not None:
            with self._program.loop(condition):
                body()
        else:
            wp.capture_while(condition, body)

    def _noted(self, name: str, kernel: wp.Kernel | None = None) -> bool:
        if self._trace is None:
            return False
        self._trace.append((name, kernel))
        return True

    @contextmanager
    def dry_run(self) -> Iterator[list[tuple[str, wp.Kernel | None]]]:
        """Within it nothing runs; the list it gives collects (name, kernel) of what would have."""
        self._trace = []
        try:
            yield self._trace
        finally:
            self._trace = None

    @contextmanager
    def record(self) -> Iterator[Program]:
        """Within it nothing runs; the program that it gives is of what would have."""
        self._program = Program(self._device, self._real)
        try:
            yield self._program
        finally:
            self._program = None


def _words(array: wp.array) -> wp.array:
    """The same memory as int32."""
    count = array.capacity // 4
    return wp.array(ptr=array.ptr, dtype=wp.int32, shape=(count,), capacity=array.capacity, device=array.device)
