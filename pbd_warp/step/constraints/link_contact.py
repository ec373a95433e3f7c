"""Lines 8 and 16 for links: contacts between capsules, and of capsules with colliders, bound to a device.

The maths is in kernels/link_contact.py, link_search.py, link_collider.py and link_bounce.py.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from pbd_warp.kernels.link_bounce import bounce_links, count_active_links
from pbd_warp.kernels.link_collider import find_link_collider_contacts
from pbd_warp.kernels.link_contact import project_link_contact
from pbd_warp.kernels.link_search import find_close_link_contacts, find_link_contacts, sweep_links
from pbd_warp.kernels.link_sides import remember_contacts
from pbd_warp.model.along import close_along
from pbd_warp.model.model import Model
from pbd_warp.step.colliders import ColliderShapes
from pbd_warp.step.context import Context

MARGIN = 0.25
"""Contacts are watched from this fraction of the sum of radii before touching: lengths that are put right within the
step move links, and a pair that was not watched could pass."""

WITHOUT_GRID = 300
"""Up to so many links (of a copy) each looks at all others (benchmarks/touching.py)."""


class LinkContacts:
    """The contacts of links in one step, in the arrays that kernels/link_contact.py describes.

    Args:
        capacity: Room for them.
        friction, restitution: Of links with each other.
        depenetration: Overlap that a step takes back at most [m]; negative: all of it.
        resting: An approach slower than this does not bounce [m/s].
        colliders: Those at rest that are round are looked at along the link, too.
    """

    def __init__(
        self,
        context: Context,
        capacity: int,
        radius: wp.array,
        depenetration: float,
        resting: float,
        colliders: ColliderShapes,
        has_friction: bool,
    ):
        self._context = context
        model = context.model
        assert model.contacts
        self.friction, self.restitution = model.contacts.friction, model.contacts.restitution
        self.capacity, self._radius, self._depenetration, self._resting = capacity, radius, depenetration, resting
        self._colliders = colliders
        self.ends, length = capsules(model)
        links = len(self.ends)
        thickness = model.radius[self.ends].max(axis=1)
        start, neighbour = close_along(self.ends, length, thickness, model.particle_count)
        upload, allocate = context.upload, context.allocate
        self.link = upload("link.ends", self.ends, wp.vec2i)
        self._left_out = (
            upload("link.neighbour_start", start, wp.int32),
            upload("link.neighbour", neighbour, wp.int32),
        )
        copy = self.ends[:, 0] // model.copy_size
        last = np.searchsorted(copy, copy, side="right")
        self._last = upload("link.last", last, wp.int32)
        self.count = allocate("link.count", 1, wp.int32)
        self.pair = allocate("link.pair", capacity, wp.vec2i)
        self.member = allocate("link.member", capacity, wp.vec4i)
        self.weight = allocate("link.weight", capacity, context.vec4)
        self.normal = allocate("link.normal", capacity, context.vec3)
        self.gap = allocate("link.gap", capacity, context.real)
        self.lam = allocate("link.lam", capacity, context.real)
        self.lam_friction = allocate("link.lam_friction", capacity, context.vec3) if has_friction else None
        self.found = (self.count, self.pair, self.member, self.weight, self.normal, self.gap)
        self._table = allocate("link.table", 1 << (2 * capacity - 1).bit_length(), wp.int32)
        self._pair_before = allocate("link.pair_before", capacity, wp.vec2i)
        self._normal_before = allocate("link.normal_before", capacity, context.vec3)
        self._middle = allocate("link.middle", links, context.vec3)
        self._extent = allocate("link.extent", links, context.real)
        self._half_box = allocate("link.half_box", links, context.vec3)
        self.grid = None
        if len(copy) and np.bincount(copy).max() > WITHOUT_GRID:
            # A ball around a typical link at rest, which a query finds in the 27 cells around its own.
            self._cell_width = float(2.0 * np.median(0.5 * length + (1.0 + MARGIN) * thickness))
            side = int(np.clip(np.ceil(np.cbrt(2.0 * links)), 8, 128))
            self.grid = wp.HashGrid(side, side, side, device=model.device, dtype=context.real)
            self.grid.reserve(links)

    def find(self, valence: wp.array) -> None:
        """Line 8; adds those found to the valence of their particles."""
        context, launch = self._context, self._context.launch
        x, w, u = context.state.x, context.w, context.u
        links = len(self.ends)
        launch.zero(self._table)
        before = (self._table, self._pair_before, self._normal_before)
        launch(remember_contacts, self.capacity, self.count, self.pair, self.normal, self.lam, *before)
        launch.zero(self.count)
        launch(sweep_links, links, self.link, self._radius, MARGIN, x, u, self._middle, self._extent, self._half_box)
        how = (self.link, self._radius, MARGIN, self._depenetration)
        if self.grid is None:
            launch(
                find_close_link_contacts,
                links,
                *(*how, *self._left_out, self._last, x, w, u, *before),
                *(self._middle, self._half_box, *self.found, valence),
            )
        else:
            launch.build_grid(self.grid, self._middle, self._cell_width)
            launch(
                find_link_contacts,
                links,
                *(self.grid.id, *how, *self._left_out, self._last, x, w, u, *before),
                *(self._middle, self._extent, self._half_box, *self.found, valence),
            )
        if self._colliders.plain:
            launch(find_link_collider_contacts, links, *self._colliders.plain, *how, x, w, u, *self.found, valence)

    def begin(self) -> None:
        self._context.launch.zero(self.lam)
        if self.lam_friction is not None:
            self._context.launch.zero(self.lam_friction)

    def project(
        self,
        u: wp.array,
        valence: wp.array | None,
        relaxation: float,
        residual: wp.array | None,
        correction: wp.array,
    ) -> None:
        """Line 10."""
        context = self._context
        context.launch(
            project_link_contact,
            self.capacity,
            *(self.friction, self._colliders.friction, context.w, *self.found, u, valence, relaxation),
            *(self.lam, self.lam_friction, residual, correction),
        )

    def count_active(self, active: wp.array) -> None:
        """Line 16: adds the contacts that pushed to the number of each particle."""
        self._context.launch(count_active_links, self.capacity, self.count, self.member, self.lam, active)

    def bounce(self, v_before: wp.array, active: wp.array, dv: wp.array) -> None:
        """Line 16: what contacts that pushed add to the velocities."""
        context = self._context
        context.launch(
            bounce_links,
            self.capacity,
            *(self.friction, self.restitution, self._colliders.friction, self._colliders.restitution, self._resting),
            *(context.state.v, context.w),
            *(self.count, self.pair, self.member, self.weight, self.normal, self.lam, v_before, active),
            dv,
        )


def capsules(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Both ends of every capsule, int32 [link_count, 2], and its length [m]: of a copy's distances, then of its
    particles with a radius that no distance has, whose ends are the same."""
    alone = model.radius > 0.0
    alone[model.distance.edge.ravel()] = False
    ball = np.flatnonzero(alone).astype(np.int32)
    ends = np.concatenate([model.distance.edge, np.stack([ball, ball], axis=1)])
    length = np.concatenate([model.distance.rest_length, np.zeros(len(ball))])
    by_copy = np.argsort(ends[:, 0] // model.copy_size, kind="stable")
    return ends[by_copy], length[by_copy]
