"""Who moves particles while a scene runs, and the loop of a run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

from pbd_warp.simulation import Simulation


class Controller(Protocol):
    """Moves particles between frames: a drag, a recording, what the pinned points of a USD stage follow."""

    @property
    def script(self) -> Any:
        """All that it does in the run; anything that JSON can hold. Files of runs with another one are not gone on
        from."""

    @property
    def memory(self) -> Any:
        """What it needs to go on from a checkpoint; anything that JSON can hold."""

    def resume(self, memory: Any, sim: Simulation) -> Simulation:
        """Go on from a checkpoint; gives the simulation that the checkpoint is of."""

    def advance(self, sim: Simulation) -> Simulation:
        """Before the frame that `step()` makes next, of the simulation that this returns."""


def play(sim: Simulation, controller: Controller, frames: int) -> Iterator[Simulation]:
    """Make frames, and give the simulation after each: the same one, or another that the controller goes on with.

    Raises:
        SimulationFailed: as `Simulation.step`.
    """
    for _ in range(frames):
        sim = controller.advance(sim)
        sim.step()
        yield sim
