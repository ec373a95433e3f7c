"""Notices which copies of a replicated model have diverged; each is judged by itself, and none stops the others."""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels.copies import check_copies
from pbd_warp.kernels.divergence import CONTACTS
from pbd_warp.step.context import NOTHING, Context
from pbd_warp.step.divergence import Limits, energy_of
from pbd_warp.step.methods.direct import DirectSolver


class CopyMonitor:
    """Takes the place of `DivergenceMonitor` where there are copies. Limits hold for each."""

    def __init__(self, context: Context, limits: Limits):
        self._context = context
        model = context.model
        n = model.copy_count
        self._counts = model.particle_count // n, len(model.distance) // n
        self._edge = context.upload("copies.edge", model.distance.edge, wp.vec2i)
        self._rest_length = context.upload("copies.rest_length", model.distance.rest_length)
        self._stretch_limit = 0.0 if limits.stretch is None else (1.0 + limits.stretch) ** 2
        self._mass = self.energy_limit = None
        if limits.energy is not None:
            self._mass = context.upload("copies.mass", model.mass)
            start = energy_of(model).reshape(n, -1).sum(axis=1)
            self.energy_limit = context.upload("copies.energy_limit", start + limits.energy, wp.float64)
        self.found = context.upload("copies.found", np.full((n, 3), NOTHING), wp.vec3i)

    def restart(self) -> None:
        """Forget what was found."""
        self._context.forget_divergence()
        self.found.fill_(wp.vec3i(NOTHING))

    def launch(self) -> None:
        """At the end of a frame."""
        context = self._context
        context.launch(
            check_copies,
            context.model.copy_count,
            *self._counts,
            *(self._edge, self._rest_length, context.gravity, self._mass, context.state.x, context.state.v),
            *(self._stretch_limit, self.energy_limit),
            *(self.found, context.diverged),
        )

    @staticmethod
    def found_any(diverged: np.ndarray) -> bool:
        """Whether there is anything to `find`."""
        return bool((diverged[:CONTACTS] != NOTHING).any())

    def find(self, solver: DirectSolver | None) -> dict[int, tuple[str, int]]:
        """What is wrong with each copy that has failed in the frame, in its own particles and edges; then all is
        forgotten. solver: Its solutions have to converge; copies in which one has not are told from then on."""
        found = self.found.numpy().copy()
        self.restart()
        first = np.argmax(found != NOTHING, axis=1)
        kinds = ("particle", "stretch", "energy")
        diverged = np.flatnonzero((found != NOTHING).any(axis=1))
        missed = self._missed(solver) if solver else np.zeros(0, int)
        return {int(k): ("newton", int(missed[k])) for k in np.flatnonzero(missed)} | {
            int(k): (kinds[first[k]], int(found[k, first[k]])) for k in diverged
        }

    def _missed(self, solver: DirectSolver) -> np.ndarray:
        """How many solutions of each copy have not converged so far, int [copy_count]."""
        model, s = self._context.model, solver.schedule
        one_a_piece = s.particle[s.piece_first[:-1]]
        return np.bincount(one_a_piece // model.copy_size, solver.missed()[one_a_piece], model.copy_count).astype(int)

    def lay_to_rest(self, copies: list[int]) -> None:
        """Put these copies back to where they began, fixed: they take no more part, and stay finite."""
        context = self._context
        state, model = context.state, context.model
        rows = np.isin(np.arange(model.particle_count) // self._counts[0], copies)
        for array, values in ((state.x, model.x), (state.v, 0.0 * model.v), (context.w, 0.0 * model.w)):
            array.assign(np.where(rows[:, None] if values.ndim > 1 else rows, values, array.numpy()))
        for array in context.arrays.values():  # multipliers and the like: what is not finite there is theirs
            there = array.numpy()
            if there.dtype.kind == "f" and not np.isfinite(there).all():
                array.assign(np.where(np.isfinite(there), there, 0.0))
