"""Contacts of links in Newton's method: kernels/link_pairs.py, bound to a device."""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels import link_pairs, pieces, weighted
from pbd_warp.step.constraints.contact import ContactConstraints
from pbd_warp.step.constraints.link_contact import LinkContacts
from pbd_warp.step.context import Context, Stage


class LinkSource:
    """From those that line 8 found (`ContactSource` of coupling.py)."""

    def __init__(self, context: Context, contacts: ContactConstraints, links: LinkContacts):
        self._context, self._contacts, self._found = context, contacts, links
        self.capacity = links.capacity
        self._round_off = float(np.finfo(context.model.dtype).eps)
        self._pairs = link_pairs.LinkPairs()
        for name, dtype in (
            *(("place", wp.int32), ("side", wp.vec3d), ("share", wp.vec4d)),
            *(("gap", wp.float64), ("rest", wp.float64)),
        ):
            setattr(self._pairs, name, context.allocate(f"direct.link_pair_{name}", self.capacity, dtype))

    def begin(self, stage: Stage, memory: weighted.Memory, contacts: weighted.Contacts) -> None:
        context, found = self._context, self._found
        context.launch(
            link_pairs.list_links,
            self.capacity,
            *(found.link, self._contacts.radius, found.friction, self._contacts.colliders.friction, context.state.x),
            *(*found.found, stage.lam_scale, self._round_off, memory, self._pairs, contacts),
        )

    def follow(self, tile: wp.array, particles: pieces.Particles, contacts: weighted.Contacts) -> None:
        context = self._context
        context.launch(
            link_pairs.follow_links,
            self.capacity,
            *(self._contacts.radius, context.state.x, context.u, tile, particles, self._pairs, contacts),
        )

    def note(self, contacts: weighted.Contacts) -> None:
        found = self._found
        self._context.launch(
            link_pairs.note_links,
            self.capacity,
            *(self._pairs, contacts, found.lam, found.member, found.weight, found.normal),
        )
