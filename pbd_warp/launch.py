"""The one door through which a step reaches the device: every launch, fill, copy and grid build goes through it,
so that a dry run can list them (`Simulation.passes`) without touching any data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import warp as wp

from pbd_warp.kernels.precision import PrecisionKernel


class Launcher:
    """Launches kernels in one precision on one device."""

    def __init__(self, device: wp.Device, real: type):
        self._device = device
        self._real = real
        self._trace: list[tuple[str, wp.Kernel | None]] | None = None

    def __call__(self, kernel: PrecisionKernel, dim: int, *args: Any) -> None:
        """Launch `kernel` over `dim` threads; nothing at all where dim is 0."""
        if dim == 0 or self._noted(kernel.name, kernel[self._real]):
            return
        wp.launch(kernel[self._real], dim=dim, inputs=args, device=self._device)

    def zero(self, array: wp.array) -> None:
        if not self._noted("zero"):
            array.zero_()

    def copy(self, target: wp.array, source: wp.array) -> None:
        if not self._noted("copy"):
            wp.copy(target, source)

    def build_grid(self, grid: wp.HashGrid, points: wp.array, cell_width: float) -> None:
        if not self._noted("HashGrid.build"):
            grid.build(points, cell_width)

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
