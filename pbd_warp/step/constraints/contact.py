"""Lines 8 and 16: contacts between particles and with colliders, bound to a device.

The maths is in kernels/contact.py and kernels/bounce.py; of colliders, see step/colliders.py.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels.bounce import bounce, count_active
from pbd_warp.kernels.contact import find_close_contacts, find_contacts, note_overflow, project_contact, sweep_midpoints
from pbd_warp.kernels.jacobi import add_corrections
from pbd_warp.model.graph import neighbours
from pbd_warp.step.colliders import ColliderShapes
from pbd_warp.step.constraints.link_contact import LinkContacts
from pbd_warp.step.context import Context, Stage

MARGIN = 0.05
"""Contacts are watched from this fraction of r_i + r_j before touching: other constraints move particles within the
step, and a pair that was not watched would overlap until the next one."""

WITHOUT_GRID = 300
"""Up to so many particles (of a copy) each looks at all others: building a grid takes longer (benchmarks/frames.py)."""

CONTACTS_PER_PARTICLE = 8
"""Room by default. Equal spheres touch at most 12 others, each contact counted once for two: 6, and 2 colliders."""

RESTING_STEPS = 2.0
"""An approach slower than gravity makes in this many steps is rest, not impact (Mueller et al. 2020, section 3.6)."""


class ContactConstraints:
    """The contacts of one step: found anew in every substep, projected in every sweep.

    Args:
        valence: Constraints that share each particle's mass but for contacts, int32 [particle_count].
        max_contacts: Room for them; by default for what equal spheres need.

    Attributes:
        valence: With the contacts of the step, on the device.
    """

    def __init__(self, context: Context, valence: np.ndarray, max_contacts: int | None = None):
        self._context = context
        model = context.model
        self._lasting_valence = context.upload("contact.lasting_valence", valence, wp.int32)
        self.valence = context.allocate("contact.valence", model.particle_count, wp.int32)
        n = model.particle_count
        self.colliders = ColliderShapes(context)
        self.pairs = model.contacts is not None and not model.contacts.links
        self.capacity = room_for_contacts(n, max_contacts)
        self.radius = context.upload("contact.radius", model.radius)
        self.count = context.allocate("contact.count", 1, wp.int32)
        self.pair = context.allocate("contact.pair", self.capacity, wp.vec2i)
        self.normal = context.allocate("contact.normal", self.capacity, context.vec3)
        self.gap = context.allocate("contact.gap", self.capacity, context.real)
        self.lam = context.allocate("contact.lam", self.capacity, context.real)
        self.lam_friction = None
        has_friction = np.any(model.colliders.friction > 0.0) or (model.contacts and model.contacts.friction > 0.0)
        if has_friction:
            self.lam_friction = context.allocate("contact.lam_friction", self.capacity, context.vec3)
        self.carried = None
        if self.colliders.moving:
            self.carried = context.allocate("contact.carried", self.capacity, context.vec3)
        self.v_before = context.allocate("contact.v_before", n, context.vec3)
        self.dv = context.allocate("contact.dv", n, context.vec3)
        self.active = context.allocate("contact.active", n, wp.int32)
        self.found = (self.count, self.pair, self.normal, self.gap)
        self.friction = model.contacts.friction if model.contacts else 0.0
        self.restitution = model.contacts.restitution if model.contacts else 0.0
        self.depenetration = -1.0  # all of an overlap in one step
        if context.depenetration_speed is not None:
            self.depenetration = context.depenetration_speed * context.dt
        self.resting = RESTING_STEPS * float(np.linalg.norm(model.gravity)) * context.dt

        self.links: LinkContacts | None = None
        if model.contacts and model.contacts.links:
            self.links = LinkContacts(
                context,
                self.capacity,
                self.radius,
                self.depenetration,
                self.resting,
                self.colliders,
                bool(has_friction),
            )
        self.neighbour_start = self.neighbour = None
        if self.pairs and len(model.distance):
            start, neighbour, _ = neighbours(model.distance.edge, n)
            self.neighbour_start = context.upload("contact.neighbour_start", start, wp.int32)
            self.neighbour = context.upload("contact.neighbour", neighbour, wp.int32)
        self.grid = None
        if self.pairs and model.copy_size > WITHOUT_GRID:
            self.max_radius = float(model.radius.max())
            self.cell_width = 2.0 * self.max_radius * (1.0 + MARGIN)
            # Some two cells a particle; the grid wraps around, so its extent does not bound the scene.
            side = int(np.clip(np.ceil(np.cbrt(2.0 * n)), 8, 128))
            self.grid = wp.HashGrid(side, side, side, device=model.device, dtype=context.real)
            self.grid.reserve(n)
            self.midpoint = context.allocate("contact.midpoint", n, context.vec3)
            self.sweep = context.allocate("contact.sweep", n, context.real)

    def restart(self) -> None:
        """Forget which links pushed each other, and from which side."""
        if self.links:
            self.links.lam.zero_()

    def find(self) -> None:
        """Line 8: generateCollisionConstraints(x -> p)."""
        context = self._context
        launch = context.launch
        n = context.model.particle_count
        x, w, u = context.state.x, context.w, context.u
        launch.zero(self.count)
        if self.carried is not None:
            launch.zero(self.carried)
        launch.copy(self.valence, self._lasting_valence)
        launch.copy(self.v_before, context.state.v)
        joined = (self.neighbour_start, self.neighbour, context.model.copy_size)
        if self.grid is not None:
            launch(sweep_midpoints, n, x, u, self.midpoint, self.sweep)
            launch.build_grid(self.grid, self.midpoint, self.cell_width)
            launch(
                find_contacts,
                n,
                *(self.grid.id, self.radius, self.max_radius, MARGIN, self.depenetration, *joined),
                *(x, w, u, self.midpoint, self.sweep),
                *(*self.found, self.valence),
            )
        elif self.pairs:
            launch(
                find_close_contacts,
                n,
                *(self.radius, MARGIN, self.depenetration, *joined),
                *(x, w, u),
                *(*self.found, self.valence),
            )
        self.colliders.find(MARGIN, self.depenetration, self.radius, (*self.found, self.carried, self.valence))
        launch(note_overflow, 1, self.count, self.capacity, context.diverged)
        if self.links:
            self.links.find(self.valence)
            launch(note_overflow, 1, self.links.count, self.capacity, context.diverged)

    def begin(self, stage: Stage) -> None:
        if self.links:
            self.links.begin()
        self._context.launch.zero(self.lam)
        if self.lam_friction is not None:
            self._context.launch.zero(self.lam_friction)

    def project(
        self,
        stage: Stage,
        u: wp.array,
        valence: wp.array | None,
        relaxation: float,
        residual: wp.array | None,
        correction: wp.array,
    ) -> None:
        """Line 10 for contacts."""
        context = self._context
        context.launch(
            project_contact,
            self.capacity,
            *(self.radius, self.friction, self.colliders.friction),
            *(context.state.x, context.w, *self.found, self.carried, u, valence, relaxation),
            *(self.lam, self.lam_friction, residual, correction),
        )
        if self.links:
            self.links.project(u, valence, relaxation, residual, correction)

    def collider_overlaps(self) -> tuple[np.ndarray, np.ndarray]:
        """How deep each particle is now in colliders (see `ColliderShapes.overlaps`)."""
        return self.colliders.overlaps(self.radius, 0.0)

    def update_velocities(self) -> None:
        """Line 16: velocityUpdate."""
        context = self._context
        launch = context.launch
        launch.zero(self.active)
        launch(count_active, self.capacity, self.count, self.pair, self.lam, self.active)
        if self.links:
            self.links.count_active(self.active)
        launch(
            bounce,
            self.capacity,
            *(self.friction, self.restitution, self.colliders.friction, self.colliders.restitution, self.resting),
            *(context.dt, context.state.x, context.state.v, context.w),
            *(self.count, self.pair, self.normal, self.carried, self.lam, self.v_before, self.active),
            self.dv,
        )
        if self.links:
            self.links.bounce(self.v_before, self.active, self.dv)
        launch(add_corrections, len(self.dv), None, self.dv, context.state.v)
        self.colliders.advance()


def room_for_contacts(particle_count: int, max_contacts: int | None) -> int:
    """How many contacts there can be in one step."""
    return max_contacts or CONTACTS_PER_PARTICLE * particle_count + 64
