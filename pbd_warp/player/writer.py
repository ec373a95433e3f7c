"""Writes a simulation's frames as something to look at: a page that plays them, or a video."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import numpy as np

from pbd_warp import check
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.model.model import Model, State
from pbd_warp.player.motion import EXTENSIONS, Motion
from pbd_warp.player.video import VIDEOS, imageio


def check_player_path(path: str | os.PathLike[str]) -> Path:
    """The path as one that a motion can be saved to, or an InputError that says why it is none."""
    out = Path(path)
    if out.suffix not in EXTENSIONS:
        raise InputError(f"{out} must end in one of {', '.join(EXTENSIONS)}, not in {out.suffix or 'nothing'!r}")
    if out.is_dir():
        raise InputError(f"{out} is a folder; name a file in it")
    check.folder(out.parent)
    if out.suffix in VIDEOS:
        imageio()
    return out


class MotionWriter:
    """Writes frames to an .html, .mp4 or .gif file; use it as `UsdWriter`, as a context manager.

    All frames are in memory until the end, as what is drawn depends on where the motion goes. After an exception
    (Ctrl-C included) those so far become a file too: under the name asked for, or, where an older file stands there,
    beside it as `<stem>.partial<extension>`. A process that is killed leaves nothing.

    Args:
        path: Where to. Its folder exists.
        model: What the states belong to.
        fps: Frames a second.
        title: What the motion is of.
        on_drawn: Called while a video is drawn, at the end, with how many of how many pictures are done.
        tension: Take the tensions of distances too, so that links can be coloured by them.

    Attributes:
        frames: Frames written so far.
        saved: The path written in the end, None until then.

    Raises:
        InputError: an unknown extension, a folder that does not exist or cannot be written to, a video without what
            the extra `video` installs.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        model: Model,
        fps: float = 60.0,
        title: str = "motion",
        on_drawn: Callable[[int, int], object] = lambda done, of: None,
        tension: bool = False,
    ):
        self.tension = tension
        self._path = check_player_path(path)
        self._model = model
        self._fps = check.number("fps", fps, above=0.0)
        self._title = title
        self._on_drawn = on_drawn
        self._positions: list[np.ndarray] = []
        self._tensions: list[np.ndarray] = []
        self.saved: Path | None = None

    @property
    def frames(self) -> int:
        return len(self._positions)

    def write(self, state: State, tension: np.ndarray | None = None) -> None:
        """Take one frame; tension: of its distances, `Simulation.tension`, where those are taken.

        Raises:
            SimulationFailed: a position is not finite.
        """
        x = state.x.numpy().astype(np.float32)  # a copy: on the CPU what comes from the device is the state itself
        if not np.isfinite(x).all():
            raise SimulationFailed(f"frame {self.frames} is not finite and was not taken into {self._path}")
        self._positions.append(x)
        if self.tension and tension is not None:
            self._tensions.append(tension.astype(np.float32))

    def flush(self) -> None:
        """Nothing survives a kill."""

    def close(self) -> None:
        """Make the file.

        Raises:
            SimulationFailed: it could not be written.
        """
        self._save(self._path)

    def __enter__(self) -> MotionWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        elif self._positions:
            beside = self._path.with_name(f"{self._path.stem}.partial{self._path.suffix}")
            self._save(beside if self._path.exists() else self._path)

    def _save(self, path: Path) -> None:
        tension = self._tensions if self.tension else None
        motion = Motion.of(self._model, self._positions, self._fps, self._title, tension)
        motion.save(path, self._on_drawn)
        self.saved = path
