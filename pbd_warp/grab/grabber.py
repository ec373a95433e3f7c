"""Select, move, deselect: whatever drags particles, a mouse, a script or a recording, does it through here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.simulation import Simulation


class Grabber:
    """Drags one particle of a simulation: exactly, or as its setting `grab_acceleration` says.

    Args:
        sim: The simulation. `sim` may be set to another that goes on from its state (`Simulation.continue_with`).
        note: Called after every gesture with its name and its value: the particle, the position, or None.
    """

    def __init__(self, sim: Simulation, note: Callable[[str, Any], object] = lambda gesture, value: None):
        self.sim = sim
        self._note = note

    @property
    def particle(self) -> int | None:
        """The grabbed particle, None for none."""
        return self.sim.held

    def select(self, particle: int) -> None:
        """Grab a particle, and let go of another. It is held where it is until it is moved."""
        self.sim.grab(particle)
        self._note("select", particle)

    def move(self, position: ArrayLike) -> None:
        """Where the grabbed particle is, or is pulled to, at the end of the next frame [m]."""
        position = check.vector("position", position)
        self.sim.move_to(position)
        self._note("move", position.tolist())

    def deselect(self) -> None:
        """Let go."""
        if self.particle is not None:
            self.sim.release()
            self._note("deselect", None)
