"""What one reads off a simulation between frames."""

from __future__ import annotations

import numpy as np

from pbd_warp.crossings import Crossing
from pbd_warp.errors import InputError
from pbd_warp.forces import Forces, constraint_forces
from pbd_warp.loop import Loop
from pbd_warp.model.model import Model, State
from pbd_warp.settings import Settings
from pbd_warp.step.context import Context
from pbd_warp.step.methods.direct import DirectSolver
from pbd_warp.watch import CrossingWatch


class Readings:
    """The part of `Simulation` that changes nothing. All arrays are copies."""

    model: Model
    settings: Settings
    state: State
    frame: int
    _loop: Loop
    _maker: Loop  # of the last frame: another one's, where it was made again
    _context: Context
    _watch: CrossingWatch | None = None

    def watch_crossings(self) -> None:
        """From now on look after every frame whether one strand passed through another (`crossings`)."""
        self._watch = CrossingWatch(self.model, self.positions.astype(np.float64))

    def _look(self) -> None:
        if self._watch:
            self._watch.look(self.positions.astype(np.float64), self.frame)

    def _look_anew(self) -> None:
        """The particles have been put somewhere else."""
        if self._watch:
            self.watch_crossings()

    @property
    def watches_crossings(self) -> bool:
        """Whether `watch_crossings` was called."""
        return self._watch is not None

    @property
    def crossings(self) -> list[Crossing]:
        """Every passage of a link's axis through another's since `watch_crossings`, in time.

        Raises:
            InputError: nobody watches.
        """
        if self._watch is None:
            raise InputError("crossings are looked for only where it is asked for: call watch_crossings() first")
        return list(self._watch.found)

    @property
    def positions(self) -> np.ndarray:
        """Now [m], shape [particle_count, 3], in the precision of the simulation."""
        return self.state.x.numpy().copy()

    @property
    def velocities(self) -> np.ndarray:
        """Now [m/s], shape [particle_count, 3], in the precision of the simulation."""
        return self.state.v.numpy().copy()

    @property
    def dt(self) -> float:
        """Length of a frame [s]."""
        return self.settings.dt

    @property
    def substeps(self) -> int | str:
        """Steps in a frame, or "auto"."""
        return self.settings.substeps

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
    def link_pairs(self) -> np.ndarray:
        """Of the last step with link contacts, int [contact_count, 2]: two links, or a link and -1 - its collider. A
        link is a distance, or, counted on, a particle with a radius that no distance has."""
        contacts = self._loop.contacts
        if not contacts or not contacts.links:
            return np.zeros((0, 2), np.int32)
        return contacts.links.pair.numpy()[: int(contacts.links.count.numpy()[0])]

    @property
    def collider_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Where colliders are now: their origins [m], float64 [collider_count, 3], and how they are turned, as
        quaternions (x, y, z, w), [collider_count, 4]."""
        c = self.model.colliders
        return self._loop.shapes.places() if self._loop.shapes else (c.centre.copy(), c.rotation.copy())

    @property
    def collider_motion(self) -> np.ndarray:
        """Of those that are looked at from frames of their own: origin [m], quaternion, velocity [m/s] and spin [rad/s]
        of each, [shape_count, 13], in the precision of the simulation; none where none may move."""
        return self._loop.shapes.motion() if self._loop.shapes else np.zeros((0, 13))

    @property
    def collider_overlaps(self) -> tuple[np.ndarray, np.ndarray]:
        """How deep each particle is in the collider in which it is deepest [m], 0: in none, and its number; float64
        and int [particle_count]."""
        x, contacts = self.state.x.numpy().astype(np.float64), self._loop.contacts
        depth, which = self.model.colliders.overlaps_at_rest(x, self.model.radius)
        if contacts:
            other, number = contacts.collider_overlaps()
            which = np.where(other > depth, number, which)
            depth = np.maximum(depth, other)
        return depth, which

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
    def missed(self) -> np.ndarray:
        """With `Direct`: how many solutions so far did not converge, of the connected piece that a particle belongs to,
        int [particle_count]. Begins anew with a frame that was made again, a reset, a change of settings."""
        return self._loop.missed

    @property
    def keeps_forces(self) -> bool:
        """Whether `forces` are known: with `Direct`."""
        return self.settings.method.keeps_forces

    @property
    def forces(self) -> Forces:
        """What constraints carried in the last step: tensions, reactions, contact forces. Reads them from the device.

        Raises:
            InputError: the method keeps no multipliers; `Direct` does.
        """
        x, w = (array.numpy().astype(np.float64) for array in (self.state.x, self._context.w))
        return constraint_forces(self.model, self._force_keeper, x, w)

    @property
    def tension(self) -> np.ndarray:
        """Force along each distance in the last step [N], pull positive, float64 [distance_count]; see `forces`."""
        return self._force_keeper.tension()

    @property
    def reaction(self) -> np.ndarray:
        """Of what holds a particle, on that particle [N], float64 [particle_count, 3]; see `forces`."""
        return self.forces.reaction

    @property
    def _force_keeper(self) -> DirectSolver:
        solver = self._maker.solver
        if not isinstance(solver, DirectSolver):
            raise InputError(f"forces are known with method 'direct', not with {self.settings.method}")
        return solver

    @property
    def passes(self) -> list[str]:
        """What one step (substep) launches, in order; a fused frame makes the same passes in one launch."""
        with self._context.launch.dry_run() as trace:
            self._loop.run_step()
        return [name for name, _ in trace]

    @property
    def fused(self) -> bool:
        """Whether a frame is one launch, in which one thread (on a GPU: one block) makes all passes."""
        return self._loop.machine is not None

    @property
    def launches(self) -> int:
        """Launches in a frame: one where it is fused, else of its steps and of the search for divergence at its end."""
        if self.fused:
            return 1
        with self._context.launch.dry_run() as trace:
            self._loop.run_frame()
        return len(trace)

    @property
    def memory(self) -> dict[str, int]:
        """Bytes on the device, by the name of each array."""
        return {name: array.capacity for name, array in self._context.arrays.items()}
