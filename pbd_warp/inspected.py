"""What a simulation can be asked of itself: what a frame launches and holds, and how the last one went."""

from __future__ import annotations

import numpy as np

from pbd_warp.loop import Loop
from pbd_warp.step.context import Context


class Inspected:
    """Part of `Simulation`."""

    _loop: Loop
    _context: Context

    @property
    def compile_seconds(self) -> float:
        """What loading (and at first use compiling) the kernels took."""
        return self._loop.compile_seconds

    @property
    def contact_pairs(self) -> np.ndarray:
        """Of the last step, int [contact_count, 2]: two particles, or a particle and -1 - its collider."""
        contacts = self._loop.contacts
        if not contacts:
            return np.zeros((0, 2), np.int32)
        return contacts.pair.numpy()[: int(contacts.count.numpy()[0])]

    @property
    def iterations_used(self) -> int:
        """Iterations of all steps of the last frame (with `Direct`, of all paths too)."""
        return self._loop.iterations_used

    @property
    def substeps_used(self) -> int:
        """Steps of the last frame; with "auto" those of the piece that took most, with what was thrown away."""
        return self._loop.steps_used

    @property
    def unconverged(self) -> int | None:
        """Steps of the last frame (paths, with `Direct`) that ended above the method's tolerance; None without one."""
        return self._loop.unconverged

    @property
    def passes(self) -> list[str]:
        """What one step (substep) launches, in order."""
        with self._context.launch.dry_run() as trace:
            self._loop.run_step()
        return [name for name, _ in trace]

    @property
    def launches(self) -> int:
        """Launches in a frame: its steps, and the search for divergence at its end."""
        with self._context.launch.dry_run() as trace:
            self._loop.run_frame()
        return len(trace)

    @property
    def memory(self) -> dict[str, int]:
        """Bytes on the device, by the name of each array."""
        return {name: array.capacity for name, array in self._context.arrays.items()}
