"""Contacts with what is fixed or led in Newton's method: kernels/touch.py, bound to a device."""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels import pieces
from pbd_warp.kernels.touch import forget_contacts, list_contacts, note_contacts
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.context import Context, Stage

RUBS = {"float32": 1e-2, "float64": 1e-4}
"""What friction gives at least in an iteration, over its particle's stiffness. Where ropes stick, rounded positions
contradict each other, and what is firmer asks for the larger forces."""


class Touches:
    """Of one step, from those that line 8 found; the forces of one are the guess for the next.

    Attributes:
        contacts: A list for each particle, which its row of Newton's matrix walks.
    """

    def __init__(self, context: Context, found: ContactConstraints, particles: pieces.Particles):
        self._context, self._found = context, found
        self.contacts = pieces.Touching()
        self.contacts.rubs = RUBS[context.model.dtype]
        count, room = context.model.particle_count, found.capacity
        for name, size, dtype in (
            *(("head", count, wp.int32), ("following", room, wp.int32), ("side", room, wp.vec3d)),
            *(("start", room, wp.vec3d), ("led", room, wp.vec3d), ("surface", room, wp.vec4d)),
            *(("lam", room, wp.float64), ("grip", room, wp.vec3d), ("status", room, wp.int32)),
        ):
            setattr(self.contacts, name, context.allocate(f"direct.contact_{name}", size, dtype))
        particles.stiffness = context.allocate("direct.stiffness", len(particles.mass), wp.float64)
        self._flat_or_round = found.colliders.flat_or_round()
        self._memory = context.allocate("direct.contact_memory", count * len(context.model.colliders), wp.vec3d)
        self._round_off = float(np.finfo(context.model.dtype).eps)

    def restart(self) -> None:
        """Forget the forces of the step before."""
        self._memory.zero_()

    def begin(self, stage: Stage) -> None:
        """List them."""
        context, found = self._context, self._found
        found.begin(stage)
        context.launch(forget_contacts, context.model.particle_count, self.contacts.head)
        context.launch(
            list_contacts,
            found.capacity,
            *(*self._flat_or_round, found.friction, found.colliders.friction),
            *(context.state.x, context.w, *found.found, found.carried, found.radius, context.u),
            *(self._memory, stage.lam_scale, self._round_off, self.contacts),
        )

    def note(self) -> None:
        """What they came to, when the step is made."""
        context, found = self._context, self._found
        context.launch.zero(self._memory)
        context.launch(
            note_contacts,
            found.capacity,
            *(found.count, found.pair, self.contacts, context.u),
            *(found.lam, found.normal, len(context.model.colliders), self._memory),
        )

    def force(self) -> np.ndarray:
        """Of colliders on each particle, friction included, over the force scale, float64 [particle_count, 3]."""
        return self._memory.numpy().reshape(self._context.model.particle_count, -1, 3).sum(axis=1)
