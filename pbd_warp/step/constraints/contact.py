"""Lines 8 and 16: contacts between particles and with colliders, bound to a simulation.

The maths is in kernels/contact.py, kernels/collider.py and kernels/bounce.py.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from pbd_warp.kernels.bounce import bounce, count_active
from pbd_warp.kernels.collider import find_collider_contacts
from pbd_warp.kernels.contact import find_contacts, note_overflow, project_contact, sweep_midpoints
from pbd_warp.kernels.jacobi import add_corrections

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation

MARGIN = 0.05
"""Contacts are watched from this fraction of r_i + r_j before touching: other constraints move particles within the
step, and a pair that was not watched would overlap until the next one."""

CONTACTS_PER_PARTICLE = 8
"""Room by default. Equal spheres touch at most 12 others, each contact counted once for two: 6, and 2 colliders."""

RESTING_STEPS = 2.0
"""An approach slower than gravity makes in this many steps is rest, not impact (Mueller et al. 2020, section 3.6)."""


class BoundContacts:
    """The contacts of one step: found anew in every substep, projected in every sweep."""

    def __init__(self, sim: Simulation):
        self._sim = sim
        model = sim.model
        n = model.particle_count
        colliders = model.colliders
        self.pairs = model.contacts is not None
        self.capacity = sim.max_contacts or CONTACTS_PER_PARTICLE * n + 64
        self.radius = sim.upload("contact.radius", model.radius)
        self.count = sim.allocate("contact.count", 1, wp.int32)
        self.needed = sim.allocate("contact.needed", 1, wp.int32)
        self.pair = sim.allocate("contact.pair", self.capacity, wp.vec2i)
        self.normal = sim.allocate("contact.normal", self.capacity, sim.vec3)
        self.gap = sim.allocate("contact.gap", self.capacity, sim.real)
        self.lam = sim.allocate("contact.lam", self.capacity, sim.real)
        self.lam_friction = None
        if np.any(colliders.friction > 0.0) or (model.contacts and model.contacts.friction > 0.0):
            self.lam_friction = sim.allocate("contact.lam_friction", self.capacity, sim.vec3)
        self.v_before = sim.allocate("contact.v_before", n, sim.vec3)
        self.dv = sim.allocate("contact.dv", n, sim.vec3)
        self.active = sim.allocate("contact.active", n, wp.int32)
        self.found = (self.count, self.pair, self.normal, self.gap)
        self.friction = model.contacts.friction if model.contacts else 0.0
        self.restitution = model.contacts.restitution if model.contacts else 0.0
        self.recovery = -1.0  # all of an overlap in one step
        if sim.depenetration_speed is not None:
            self.recovery = sim.depenetration_speed * sim.substep_dt
        self.resting = RESTING_STEPS * float(np.linalg.norm(model.gravity)) * sim.substep_dt

        self.kind = sim.upload("collider.kind", colliders.kind, wp.int32)
        self.centre = sim.upload("collider.centre", colliders.centre, sim.vec3)
        self.plane_normal = sim.upload("collider.normal", colliders.normal, sim.vec3)
        self.size = sim.upload("collider.size", colliders.size)
        self.collider_friction = sim.upload("collider.friction", colliders.friction)
        self.collider_restitution = sim.upload("collider.restitution", colliders.restitution)

        if self.pairs:
            self.max_radius = float(model.radius.max())
            self.cell_width = 2.0 * self.max_radius * (1.0 + MARGIN)
            # Some two cells a particle; the grid wraps around, so its extent does not bound the scene.
            side = int(np.clip(np.ceil(np.cbrt(2.0 * n)), 8, 128))
            self.grid = wp.HashGrid(side, side, side, device=model.device, dtype=sim.real)
            self.grid.reserve(n)
            self.midpoint = sim.allocate("contact.midpoint", n, sim.vec3)
            self.sweep = sim.allocate("contact.sweep", n, sim.real)
            self.neighbour_start = self.neighbour = None
            if len(model.distance):
                start, neighbour = neighbours(model.distance.edge, n)
                self.neighbour_start = sim.upload("contact.neighbour_start", start, wp.int32)
                self.neighbour = sim.upload("contact.neighbour", neighbour, wp.int32)

    def find(self) -> None:
        """Line 8: generateCollisionConstraints(x -> p)."""
        sim = self._sim
        launch = sim.launch
        n = sim.model.particle_count
        x, w, u = sim.state.x, sim.w, sim.u
        launch.zero(self.count)
        launch.copy(sim.share, sim.valence)
        launch.copy(self.v_before, sim.state.v)
        if self.pairs:
            launch(sweep_midpoints, n, x, u, self.midpoint, self.sweep)
            launch.build_grid(self.grid, self.midpoint, self.cell_width)
            launch(
                find_contacts,
                n,
                *(
                    self.grid.id,
                    self.radius,
                    self.max_radius,
                    MARGIN,
                    self.recovery,
                    self.neighbour_start,
                    self.neighbour,
                ),
                *(x, w, u, self.midpoint, self.sweep),
                *(*self.found, sim.share),
            )
        if len(self.kind):
            launch(
                find_collider_contacts,
                n,
                *(self.kind, self.centre, self.plane_normal, self.size, self.radius, MARGIN, self.recovery),
                *(x, w, u),
                *(*self.found, sim.share),
            )
        launch(note_overflow, 1, self.count, self.capacity, self.needed)

    def begin(self) -> None:
        self._sim.launch.zero(self.lam)
        if self.lam_friction is not None:
            self._sim.launch.zero(self.lam_friction)

    def project(
        self, u: wp.array, share: wp.array | None, relaxation: float, residual: wp.array | None, correction: wp.array
    ) -> None:
        """Line 10 for contacts."""
        sim = self._sim
        sim.launch(
            project_contact,
            self.capacity,
            *(self.radius, self.friction, self.collider_friction),
            *(sim.state.x, sim.w, *self.found, u, share, relaxation),
            *(self.lam, self.lam_friction, residual, correction),
        )

    def update_velocities(self) -> None:
        """Line 16: velocityUpdate."""
        sim = self._sim
        launch = sim.launch
        launch.zero(self.active)
        launch(count_active, self.capacity, self.count, self.pair, self.lam, self.active)
        launch(
            bounce,
            self.capacity,
            *(self.friction, self.restitution, self.collider_friction, self.collider_restitution, self.resting),
            *(sim.state.x, sim.state.v, sim.w),
            *(self.count, self.pair, self.normal, self.lam, self.v_before, self.active),
            self.dv,
        )
        launch(add_corrections, len(self.dv), None, self.dv, sim.state.v)


def neighbours(edge: np.ndarray, particle_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Adjacency of a graph: the neighbours of i are neighbour[start[i]:start[i + 1]]."""
    both = np.concatenate([edge, edge[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    start = np.searchsorted(both[order, 0], np.arange(particle_count + 1))
    return start, both[order, 1]
