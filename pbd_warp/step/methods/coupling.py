"""Contacts between pieces in Newton's method: kernels/coupled.py and what it needs, bound to a device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import warp as wp

from pbd_warp.kernels import pairs, pieces, ports, weighted
from pbd_warp.kernels.coupled import (
    begin_iterations,
    begin_pieces,
    eliminate_pieces,
    end_pieces,
    load_pieces,
    step_pieces,
)
from pbd_warp.kernels.sweeps import judge_contacts, sweep_contacts
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.context import Context, Stage
from pbd_warp.step.methods.schedule import Schedule

ROOM = 1 << 20
"""Responses of particles that contacts touch to each other, 72 bytes each: a piece with n of them takes n^2."""


class ContactSource(Protocol):
    """Whoever finds contacts whose particles move.

    capacity: How many there can be in one step.
    begin: List those of this step (`add_contact` of kernels/weighted.py).
    follow: Take each to where its particles are now (`turn_contact`).
    note: What they came to, when the step is made.
    """

    capacity: int

    def begin(self, stage: Stage, memory: weighted.Memory, contacts: weighted.Contacts) -> None: ...

    def follow(self, tile: wp.array, particles: pieces.Particles, contacts: weighted.Contacts) -> None: ...

    def note(self, contacts: weighted.Contacts) -> None: ...


class PairSource:
    """Contacts of two free particles, from those that line 8 found."""

    def __init__(self, context: Context, contacts: ContactConstraints):
        self._context, self._found = context, contacts
        self.capacity = contacts.capacity
        self._round_off = float(np.finfo(context.model.dtype).eps)
        self._pairs = pairs.Pairs()
        for name, dtype in ("place", wp.int32), ("side", wp.vec3d), ("start", wp.vec3d), ("surface", wp.vec4d):
            setattr(self._pairs, name, context.allocate(f"direct.pair_{name}", self.capacity, dtype))

    def begin(self, stage: Stage, memory: weighted.Memory, contacts: weighted.Contacts) -> None:
        context, found = self._context, self._found
        context.launch(
            pairs.list_pairs,
            self.capacity,
            *(found.radius, found.friction, context.state.x, context.w, *found.found),
            *(stage.lam_scale, self._round_off, memory, self._pairs, contacts),
        )

    def follow(self, tile: wp.array, particles: pieces.Particles, contacts: weighted.Contacts) -> None:
        self._context.launch(pairs.follow_pairs, self.capacity, tile, particles, self._pairs, contacts)

    def note(self, contacts: weighted.Contacts) -> None:
        self._context.launch(pairs.note_pairs, self.capacity, self._pairs, contacts, self._found.lam)


@dataclass(frozen=True)
class System:
    """What Newton's method works on, of all pieces."""

    schedule: pieces.Schedule
    matrix: pieces.Matrix
    particles: pieces.Particles
    links: pieces.Links
    points: pieces.Points
    touching: pieces.Touching
    bends: pieces.Bends

    @property
    def parts(self) -> tuple[Any, ...]:
        """As kernels take them, after the schedule."""
        return self.matrix, self.particles, self.links, self.points, self.touching, self.bends


@dataclass(frozen=True)
class Tolerance:
    """Where Newton's method ends.

    iterations: At most.
    length: What may be left [m].
    relative: The same over the lengths that it is the difference of.
    close: Of gap and slip of a contact, over the lengths that they are the difference of.
    accepted, accepted_contact: Times the tolerance: what counts as converged where iterations end above it.
    """

    iterations: int
    length: float
    relative: float
    close: float
    accepted: float
    accepted_contact: float


class Coupling:
    """Pieces that contacts join, solved together.

    Attributes:
        coupled: Which pieces those are in this step, on the device: 1 or 0, [piece_count].
        contacts: All contacts of the step.
    """

    def __init__(self, context: Context, sources: Sequence[ContactSource], schedule: Schedule, system: System):
        self._context, self._sources, self._system = context, sources, system
        tiles, count = len(schedule.particle), len(schedule.piece_first) - 1
        self._tiles, self._count = tiles, count
        size = np.diff(schedule.piece_first)
        room = int(min(np.sum(size**2), ROOM))
        self._capacity = capacity = sum(source.capacity for source in sources)
        system.matrix.swap = context.allocate("direct.swap", tiles, wp.mat33d)
        self._ports = self._structure(
            ports.Ports,
            "port",
            *(("of_tile", tiles, wp.int32), ("to_tile", tiles, wp.int32), ("count", count, wp.int32)),
            *(("coupled", count, wp.int32), ("first", count, wp.int32), ("used", 1, wp.int32)),
            *(("response", room, wp.mat33d), ("column", tiles, wp.mat33d), ("y", tiles, wp.vec3d)),
            *(("stiffness", tiles, wp.float64), ("move", tiles, wp.vec3d), ("load", tiles, wp.vec3d)),
        )
        self._ports.piece = context.upload("direct.piece_of_tile", np.repeat(np.arange(count), size), wp.int32)
        self._ports.tile = context.upload("direct.tile", schedule.tile, wp.int32)
        self.coupled = self._ports.coupled
        self.contacts = self._structure(
            weighted.Contacts,
            "coupled",
            *(("count", 1, wp.int32), ("member", capacity, wp.vec4i), ("weight", capacity, wp.vec4d)),
            *((name, capacity, wp.float64) for name in ("gap", "friction", "size", "rounding", "turned")),
            *((name, capacity, wp.vec3d) for name in ("normal", "carried", "force", "before", "change", "way")),
            *(("port", capacity, wp.vec4i), ("response", capacity, wp.mat33d)),
        )
        self._memory = self._structure(
            weighted.Memory,
            "memory",
            *(("head", context.model.particle_count, wp.int32), ("following", capacity, wp.int32)),
            *(("member", capacity, wp.vec4i), ("force", capacity, wp.vec3d)),
        )
        self._pieces = wp.zeros(count, dtype=pieces.Progress, device=context.model.device)
        self._progress = context.allocate("direct.progress", 2, wp.float64)
        self._going = context.allocate("direct.going", 1, wp.int32)

    def _structure(self, kind: Any, prefix: str, *arrays: tuple[str, int, Any]) -> Any:
        structure = kind()
        for name, size, dtype in arrays:
            setattr(structure, name, self._context.allocate(f"direct.{prefix}_{name}", size, dtype))
        return structure

    def restart(self) -> None:
        """Forget the forces of the step before."""
        self.contacts.count.zero_()

    def begin(self, stage: Stage) -> None:
        """Contacts of the step, and which pieces they join."""
        launch, c = self._context.launch, self.contacts
        launch(weighted.forget_forces, self._context.model.particle_count, self._memory)
        launch(weighted.remember_forces, self._capacity, c, self._memory)
        launch.zero(c.count)
        for source in self._sources:
            source.begin(stage, self._memory, c)
        launch(ports.clear_ports, self._tiles, self._ports)
        launch(ports.mark_ports, self._capacity, c, self._ports)
        launch.zero(self._ports.used)
        launch(ports.number_ports, self._count, self._system.schedule, self._ports, self._context.diverged)
        launch(ports.find_ports, self._capacity, self._ports, c)

    def solve(
        self, stage: Stage, model: Sequence[Any], base: wp.array, reach: float, until: Tolerance, counters: wp.array
    ) -> None:
        """Newton's method on the pieces that are coupled; `model`: the arguments that begin those of solve_pieces."""
        context, system, c, p = self._context, self._system, self.contacts, self._system.particles
        launch, going = context.launch, self._going
        parts = system.parts
        close = (until.length, until.close)
        launch(
            begin_pieces,
            self._count,
            *(system.schedule, *model, base, stage.compliance_scale, stage.lam_scale),
            *(self.coupled, p, system.links, system.points, system.bends, context.u, self._pieces),
        )
        self._follow()
        launch(begin_iterations, 1, self._ports, self._progress, going)

        def iterate() -> None:
            launch(load_pieces, self._capacity, p, self._ports, c, system.matrix)
            launch(eliminate_pieces, self._count, system.schedule, *parts, self._ports, self._pieces)
            launch(sweep_contacts, 1, system.schedule, self._progress, *close, self._ports, c)
            launch(
                step_pieces,
                self._count,
                *(system.schedule, reach, until.length, until.relative, until.close, *parts, self._ports, self._pieces),
            )
            self._follow()
            launch(
                judge_contacts,
                1,
                *(p, self._ports, c, self._pieces, until.iterations, *close, self._progress, going),
            )

        launch.loop(going, iterate)
        launch(
            end_pieces,
            self._count,
            *(system.schedule, self._ports, self._pieces, self._progress),
            *(until.accepted, until.accepted_contact),
            *(p, system.links, context.u, counters[0:1], counters[1:2]),
        )
        for source in self._sources:
            source.note(c)

    def add_forces(self, force: np.ndarray) -> None:
        """To those on the particles, over the force scale, [particle_count, 3]."""
        c = self.contacts
        count = min(int(c.count.numpy()[0]), self._capacity)
        member, weight, push = (array.numpy()[:count] for array in (c.member, c.weight, c.force))
        for m in range(4):
            some = member[:, m] >= 0
            np.add.at(force, member[some, m], weight[some, m, None] * push[some])

    def _follow(self) -> None:
        for source in self._sources:
            source.follow(self._ports.tile, self._system.particles, self.contacts)
