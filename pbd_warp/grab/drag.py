"""Recorded drags: the three gestures of a mouse, (time, select | move | deselect), played back on a simulation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pbd_warp import check
from pbd_warp.errors import InputError, unknown
from pbd_warp.grab.grabber import Grabber
from pbd_warp.simulation import Simulation

GESTURES = ("select", "move", "deselect")


@dataclass(frozen=True, eq=False)
class _Hold:
    """One particle from select to deselect, and the way it is led."""

    particle: int
    start: float
    end: float
    times: np.ndarray
    positions: np.ndarray

    def target(self, time: float, selected_at: np.ndarray) -> np.ndarray:
        times = np.append(self.start, self.times)
        path = np.vstack([selected_at, self.positions])
        return np.array([np.interp(time, times, axis) for axis in path.T])


class Drag:
    """A script of gestures, ordered by time [s]:

        (time, "select", particle), (time, "move", position), ..., (time, "deselect")

    From where it was selected to the first move, and from move to move, the target goes in straight lines at constant
    speed, so a script means the same at every frame rate and nothing ever jumps.

    Raises:
        InputError: gestures that are unknown, out of order in time, or without a particle in hand.
    """

    def __init__(self, gestures: Iterable[Sequence[Any]] = ()):
        self.gestures = [tuple(gesture) for gesture in gestures]
        self._holds = _parse(self.gestures)
        self.script = [[float(time), what, *np.ravel(value).tolist()] for time, what, *value in self.gestures]
        self._now: _Hold | None = None
        self._selected_at = np.zeros(3)

    def check_particles(self, particle_count: int) -> None:
        """Raise an InputError for a script that selects a particle there is not; better before a run than in it."""
        check.indices("drag: select", [hold.particle for hold in self._holds], particle_count)

    @property
    def memory(self) -> dict[str, Any]:
        """For a checkpoint: of the particle that is held which hold it is, and where it was selected."""
        now = None if self._now is None else [self._holds.index(self._now), self._selected_at.tolist()]
        return {"now": now}

    def resume(self, memory: dict[str, Any], sim: Simulation) -> Simulation:
        """Go on from a checkpoint of the simulation, which holds the particle already.

        Raises:
            InputError: this script would not have left that.
        """
        now = memory.get("now", ()) if isinstance(memory, dict) else ()
        if now is not None:
            if not isinstance(now, list) or len(now) != 2:
                raise InputError("the checkpoint does not say where the drag was")
            check.indices("the checkpoint's drag", [now[0]], len(self._holds))
            self._now, self._selected_at = self._holds[now[0]], check.vector("the checkpoint's drag", now[1])
        return sim

    def advance(self, sim: Simulation) -> Simulation:
        """Do what the script says for the frame that `sim.step()` makes next; gives the simulation back."""
        # Frame times are multiples of dt; a gesture at one of them must not slip to the next by rounding.
        now = sim.time + 1e-9 * sim.dt
        grabber = Grabber(sim)
        if self._now and self._now.end <= now:
            grabber.deselect()
            self._now = None
        for hold in self._holds:
            if hold.start <= now < hold.end and hold is not self._now:
                grabber.select(hold.particle)
                self._now = hold
                # A copy: on the CPU what comes from the device is the live state itself.
                self._selected_at = sim.state.x[hold.particle : hold.particle + 1].numpy()[0].astype(np.float64)
        if self._now:
            grabber.move(self._now.target((sim.frame + 1) * sim.dt, self._selected_at))
        return sim


def _parse(gestures: list[tuple[Any, ...]]) -> list[_Hold]:
    holds: list[_Hold] = []
    particle: int | None = None
    start = last = -np.inf
    moves: list[tuple[float, np.ndarray]] = []

    def close(end: float) -> None:
        if particle is not None:
            times = np.array([time for time, _ in moves])
            holds.append(_Hold(particle, start, end, times, np.array([p for _, p in moves]).reshape(-1, 3)))
            moves.clear()

    for number, gesture in enumerate(gestures):
        what = f"drag gesture {number}"
        if len(gesture) < 2 or gesture[1] not in GESTURES:
            raise unknown(f"{what}: gesture", gesture[1] if len(gesture) > 1 else gesture, GESTURES)
        time = check.number(f"{what}: time", gesture[0], low=0.0)
        if time < last:
            raise InputError(f"{what}: time {time:g} s comes after {last:g} s; the script goes forward in time")
        last = time
        if len(gesture) != (2 if gesture[1] == "deselect" else 3):
            raise InputError(
                f"{what}: write (time, 'select', particle), (time, 'move', position) or (time, 'deselect')"
            )
        if gesture[1] == "select":
            close(time)
            particle, start = check.whole(f"{what}: particle", gesture[2], low=0), time
        elif particle is None:
            raise InputError(f"{what}: {gesture[1]} without a selected particle; select one first")
        elif gesture[1] == "move":
            moves.append((time, check.vector(f"{what}: position", gesture[2])))
        else:
            close(time)
            particle = None
    close(np.inf)
    return holds
