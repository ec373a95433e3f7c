"""A motion that is done: where all particles were, frame by frame."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pbd_warp.atomic import replacing
from pbd_warp.errors import InputError
from pbd_warp.model.model import Model
from pbd_warp.player.drawn import Drawn
from pbd_warp.player.html import inline, page
from pbd_warp.player.serve import serve
from pbd_warp.player.video import VIDEOS, save_video

EXTENSIONS = (".html", *VIDEOS)


@dataclass(frozen=True, repr=False)
class Motion:
    """A motion that is done. In Jupyter it shows itself.

    drawn: What is drawn besides positions. positions: [m], float32 [frame_count, particle_count, 3]. fps: Frames a
    second. title: What it is of. stretch_from: What stretch is measured against, in words. tension: Of the links [N],
    pull positive, float32 [frame_count, link_count]; None where it is not known.
    """

    drawn: Drawn
    positions: np.ndarray
    fps: float
    title: str = "motion"
    stretch_from: str = "rest length"
    tension: np.ndarray | None = None

    @classmethod
    def of(
        cls,
        model: Model,
        positions: Sequence[np.ndarray] | np.ndarray,
        fps: float,
        title: str,
        tension: Sequence[np.ndarray] | np.ndarray | None = None,
        places: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> Motion:
        """The motion of a model, frame by frame: positions [particle_count, 3] and tensions [distance_count]. places:
        Where colliders are at its start, `Simulation.collider_places`; where the model has them unless given."""
        pulls = None if tension is None else np.asarray(tension, dtype=np.float32)
        return cls(Drawn.of_model(model, places), np.asarray(positions, dtype=np.float32), fps, title, tension=pulls)

    @property
    def frame_count(self) -> int:
        return len(self.positions)

    def html(self) -> str:
        """A page that plays it, without any network: play, scrub, turn, colour by stretch or tension."""
        scene = self.drawn.around(self.positions)
        return page(scene, self.positions, self.fps, self.title, self.stretch_from, self.tension)

    def save(
        self, path: str | os.PathLike[str], on_drawn: Callable[[int, int], object] = lambda done, of: None
    ) -> None:
        """Write an .html that plays it, an .mp4 or a .gif; the file appears when it is complete.

        Args:
            on_drawn: Called while a video is drawn with how many of how many pictures are done.

        Raises:
            InputError: another ending, or the extra `video` is not installed.
            SimulationFailed: it could not be written.
        """
        out = Path(path)
        if out.suffix not in EXTENSIONS:
            raise InputError(f"{out} must end in one of {', '.join(EXTENSIONS)}, not in {out.suffix or 'nothing'!r}")
        with replacing(out, out.with_name(f".{out.stem}.{os.getpid()}{out.suffix}")) as temporary:
            if out.suffix == ".html":
                temporary.write_text(self.html(), encoding="utf-8")
            else:
                save_video(self.drawn, self.positions, self.fps, temporary, on_drawn)

    def show(self) -> None:
        """Open it in the browser, and go on when the page has arrived there; in Jupyter below the cell."""
        if in_notebook():
            importlib.import_module("IPython.display").display(self)
        else:
            serve(self.html(), self.title)

    def _repr_html_(self) -> str:
        return inline(self.html())

    def __repr__(self) -> str:
        frames, particles, _ = self.positions.shape
        return f"Motion({self.title!r}, {frames} frames of {particles} particles at {self.fps:g} a second)"


def in_notebook() -> bool:
    """Whether a Jupyter kernel runs this."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and hasattr(shell, "kernel")
