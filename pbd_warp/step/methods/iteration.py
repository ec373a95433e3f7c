"""The loop of lines 9-11: a number of iterations, or until the residual is below a tolerance."""

from __future__ import annotations

from collections.abc import Callable

import warp as wp

from pbd_warp import check
from pbd_warp.kernels.iteration import begin_iterations, end_iteration
from pbd_warp.step.context import Context

MOST_ITERATIONS = 1_000_000
"""Of a step: far beyond what is of use, and below where counting in 32 bits ends."""


def check_iterations(iterations: int, tolerance: float | None) -> None:
    """Iterations of at least 1 and a tolerance above 0, or an InputError."""
    check.whole("iterations", iterations, low=1, high=MOST_ITERATIONS)
    if tolerance is not None:
        check.number("tolerance", tolerance, above=0.0)


class Iterations:
    """Runs sweeps; with a tolerance the device decides after each whether there is another one.

    residual: What sweeps write the largest |C| to. count: This iteration on the device, from 1. another: Whether there
    is another one. counters: Iterations of the frame, and how many of its steps ended above the
    tolerance, int32 [2]. All None without a tolerance.
    """

    def __init__(self, context: Context, iterations: int, tolerance: float | None):
        self._context = context
        self._iterations = iterations
        self._tolerance = tolerance
        self.residual = self.count = self.another = self.counters = None
        if tolerance is not None:
            self.residual = context.allocate("iteration.residual", 1, context.real)
            self.count = context.allocate("iteration.count", 1, wp.int32)
            self.another = context.allocate("iteration.another", 1, wp.int32)
            self.counters = context.allocate("iteration.counters", 2, wp.int32)

    def run(self, project: Callable[[], None], apply: Callable[[int], None]) -> None:
        """`project()` evaluates the constraints, `apply(k)` then moves the particles by what came out in iteration k.

        With a tolerance k is always 0, and `count` on the device says which iteration it is.
        """
        if self._tolerance is None:
            for k in range(self._iterations):
                project()
                apply(k)
            return
        launch = self._context.launch
        launch(begin_iterations, 1, self.count, self.another, self.residual)
        launch.loop(self.another, lambda: self._iterate(project, apply))

    def _iterate(self, project: Callable[[], None], apply: Callable[[int], None]) -> None:
        assert self.counters is not None
        project()
        self._context.launch(
            end_iteration,
            1,
            *(self._tolerance, self._iterations),
            *(self.residual, self.count, self.another, self.counters[0:1], self.counters[1:2]),
        )
        apply(0)
