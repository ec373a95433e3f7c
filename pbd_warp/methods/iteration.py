"""The loop of lines 9-11: a number of iterations, or until the residual is below a tolerance."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import warp as wp

from pbd_warp.kernels.iteration import begin_iterations, end_iteration

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


class Iterations:
    """Runs sweeps; with a tolerance the device decides after each whether there is another one.

    residual: What sweeps write the largest |C| to, None without a tolerance. count: The number of this sweep on the
    device, None where the host knows it.
    """

    def __init__(self, sim: Simulation, iterations: int, tolerance: float | None):
        self._sim = sim
        self._iterations = iterations
        self._tolerance = tolerance
        self.residual = self.count = None
        if tolerance is not None:
            self.residual = sim.allocate("iteration.residual", 1, sim.real)
            self.count = sim.allocate("iteration.count", 1, wp.int32)
            self._another = sim.allocate("iteration.another", 1, wp.int32)
            self._counters = sim.count_iterations()

    def run(self, sweep: Callable[[int], None]) -> None:
        """`sweep(k)` makes iteration k; with a tolerance k is always 0, and `count` on the device says which it is."""
        if self._tolerance is None:
            for k in range(self._iterations):
                sweep(k)
            return
        launch = self._sim.launch
        launch(begin_iterations, 1, self.count, self._another, self.residual)
        launch.loop(self._another, lambda: self._sweep_and_decide(sweep))

    def _sweep_and_decide(self, sweep: Callable[[int], None]) -> None:
        sim = self._sim
        sweep(0)
        sim.launch(
            end_iteration,
            1,
            *(self._tolerance, self._iterations),
            *(self.residual, self.count, self._another, *self._counters),
        )
