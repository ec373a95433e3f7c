"""The hand: select, move, deselect. Whatever leads particles, a mouse or a recording of one, does it through here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.grab.camera import Camera
from pbd_warp.simulation import Simulation

REACH = 14.0
"""A click this near to a particle selects it [px]."""


class Grabber:
    """Leads one particle of a simulation.

    By name: `select`, `move`, `deselect`. As seen on a screen: `click` selects the particle that is there, or lets go
    of the one in hand; `hover` moves the one in hand, with no button held. It moves in the plane through it that
    faces the camera.

    Args:
        sim: The simulation. `sim` may be set to another that goes on from its state (`Simulation.continue_with`).
        note: Called after every gesture with its name and its value: the particle, the position, or None.
    """

    def __init__(self, sim: Simulation, note: Callable[[str, Any], object] = lambda gesture, value: None):
        self.sim = sim
        self._note = note

    @property
    def particle(self) -> int | None:
        """Who is in hand, None for nobody."""
        return self.sim.held

    def select(self, particle: int) -> None:
        """Take a particle, and let go of another. It stays where it is until it is moved."""
        self.sim.grab(particle)
        self._note("select", particle)

    def move(self, position: ArrayLike) -> None:
        """Where the particle in hand is at the end of the next frame [m]."""
        position = check.vector("position", position)
        self.sim.move_to(position)
        self._note("move", position.tolist())

    def deselect(self) -> None:
        """Let go."""
        if self.particle is not None:
            self.sim.release()
            self._note("deselect", None)

    def click(self, camera: Camera, at: ArrayLike, radius: np.ndarray) -> None:
        """Select the particle at a place on the screen [px], or let go; `radius` [m], [particle_count], as drawn."""
        if self.particle is not None:
            self.deselect()
            return
        picked = camera.pick(self.sim.state.x.numpy().astype(np.float64), radius, at, REACH)
        if picked is not None:
            self.select(picked)

    def hover(self, camera: Camera, at: ArrayLike) -> None:
        """Move the particle in hand to a place on the screen [px]; nothing without one."""
        if self.particle is not None:
            assert self.sim.held_target is not None
            self.move(camera.on_facing_plane(at, self.sim.held_target))
