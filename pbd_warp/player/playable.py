"""Running a simulation for a while, and seeing it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, ClassVar

import numpy as np

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.model.model import Model, State
from pbd_warp.player.motion import Motion, in_notebook
from pbd_warp.progress import progress_bar
from pbd_warp.settings import Settings

SHOWN_SECONDS = 5.0


class Playable(ABC):
    """The part of `Simulation` that makes a `Motion` of it."""

    model: Model
    settings: Settings
    state: State
    frame: int
    open_live: ClassVar[Callable[[Any], None]]
    """Opens the live view on one; that room lies above this one, and puts this here (show.py)."""

    @property
    @abstractmethod
    def keeps_forces(self) -> bool: ...

    @property
    @abstractmethod
    def tension(self) -> np.ndarray: ...

    @property
    @abstractmethod
    def collider_places(self) -> tuple[np.ndarray, np.ndarray]: ...

    @abstractmethod
    def step(self) -> None: ...

    @abstractmethod
    def continue_with(self, settings: Settings | None = None, **changes: Any) -> Any: ...

    def run(self, seconds: float | None = None, *, frames: int | None = None, progress: bool = False) -> Motion:
        """Step for a while; the motion, with where particles were before, can be shown or saved.

        Args:
            seconds: How long [s], to the nearest frame; or
            frames: how many frames.
            progress: Show how far it is: a bar on a terminal, elsewhere a line every ten seconds.

        Raises:
            InputError: neither or both are given.
            SimulationFailed: as `step`.
        """
        if (seconds is None) == (frames is None):
            raise InputError("run needs seconds or frames, and not both: run(2.5), or run(frames=150)")
        if seconds is not None:
            count = round(check.number("seconds", seconds, low=0.0) / self.settings.dt)
        else:
            count = check.whole("frames", frames, low=0)
        positions = np.empty((count + 1, self.model.particle_count, 3), np.float32)
        positions[0] = self.state.x.numpy()
        places = self.collider_places
        tension = np.empty((count + 1, len(self.model.distance)), np.float32) if self.keeps_forces else None
        if tension is not None:
            tension[0] = self.tension
        with progress_bar("frames") if progress else nullcontext(lambda done, of: None) as advance:
            for done in range(1, count + 1):
                self.step()
                positions[done] = self.state.x.numpy()
                if tension is not None:
                    tension[done] = self.tension
                advance(done, count)
        title = f"frames from {self.frame - count}"
        return Motion.of(self.model, positions, self.settings.fps, title, tension, places)

    def show(self, seconds: float | None = None) -> None:
        """Open the live view on it, as it is now, until Ctrl-C; in Jupyter, a player of the next five seconds below the
        cell. This simulation stays where it is.

        Args:
            seconds: Play so much of what comes next instead [s].
        """
        if seconds is None and not in_notebook():
            self.open_live()
        else:
            self._preview(SHOWN_SECONDS if seconds is None else seconds).show()

    def _preview(self, seconds: float = SHOWN_SECONDS) -> Motion:
        motion: Motion = self.continue_with().run(seconds)
        return motion

    def _repr_html_(self) -> str:
        return self._preview()._repr_html_()
