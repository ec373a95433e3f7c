"""The frames that a view can go back to, and those that are kept as a clip."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.kernels.precision import PRECISIONS
from pbd_warp.model.model import Model, State
from pbd_warp.simulation import Simulation
from pbd_warp.usd.writer import UsdWriter

SECONDS = 10.0
"""One can go back by so much."""

ROOM = 512 * 2**20
"""Bytes, of all frames that are kept."""


class Kept(NamedTuple):
    """A frame: positions and velocities [particle_count, 3]; tensions [N], float32 [distance_count], none where the
    method does not know them; where colliders that move are and how they do, see `ColliderShapes.motion`."""

    x: np.ndarray
    v: np.ndarray
    tension: np.ndarray
    motion: np.ndarray


class Frames:
    """States by the number of their frame, without gaps: the last ten seconds, or all of them while `keep` is set."""

    def __init__(self, fps: float):
        self._most = max(2, int(SECONDS * fps) + 1)
        self._states: deque[Kept] = deque()
        self.last = -1
        self.keep = False

    @property
    def first(self) -> int:
        """The earliest frame there is."""
        return self.last - len(self._states) + 1

    @property
    def full(self) -> bool:
        """Whether there is no room for more."""
        return len(self._states) > 1 and (len(self._states) + 1) * self._size > ROOM

    @property
    def _size(self) -> int:
        return sum(array.nbytes for array in self._states[-1])

    def add(self, sim: Simulation) -> None:
        """The next frame, as it is now."""
        tension = sim.tension.astype(np.float32) if sim.keeps_forces else np.zeros(0, np.float32)
        self._states.append(Kept(sim.positions, sim.velocities, tension, sim.collider_motion))
        self.last += 1
        while len(self._states) > 1 and not self.keep and (len(self._states) > self._most or self.full):
            self._states.popleft()

    def at(self, frame: int) -> Kept:
        """Raises an InputError for a frame that there is not."""
        if not self.first <= frame <= self.last:
            raise InputError(f"frame {frame} is not kept: there are {self.first} to {self.last}")
        return self._states[frame - self.first]

    def cut(self, frame: int) -> Kept:
        """A frame; forget what came after it."""
        self.at(frame)
        while self.last > frame:
            self._states.pop()
            self.last -= 1
        return self._states[-1]

    def since(self, frame: int) -> list[Kept]:
        """All states from a frame on."""
        return list(self._states)[max(frame - self.first, 0) :]


@dataclass(frozen=True)
class Clip:
    """Frames to be saved: states of a model, at a rate; about: what the file says of how they were made."""

    name: str
    model: Model
    fps: float
    states: list[Kept]
    about: dict[str, Any] = field(default_factory=dict)

    def write(self, path: Path) -> None:
        """As a USD animation.

        Raises:
            SimulationFailed: it could not be written.
        """
        vector = PRECISIONS[self.model.real]["Vec3"]
        host = next(device for device in wp.get_devices() if device.is_cpu)  # where the values are
        with UsdWriter(path, self.model, self.fps, self.about) as writer:
            for x, v, *_ in self.states:
                writer.write(State(*(wp.array(values, dtype=vector, device=host) for values in (x, v))))
