"""Draws a motion as an .mp4 or a .gif (extra `video`)."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np

from pbd_warp.errors import InputError
from pbd_warp.player.drawn import Drawn
from pbd_warp.player.render import Renderer

VIDEOS = (".mp4", ".gif")

SIZE = {".mp4": (1280, 720), ".gif": (480, 270)}
"""Pixels: width and height, both even, which the codec of most .mp4 files asks for."""

GIF_RATE = 25.0
"""Frames a second that a .gif has at most: browsers slow down what has more than 50."""

MP4_RATE = 60.0


def imageio() -> ModuleType:
    """imageio.v2, which writes videos.

    Raises:
        InputError: it is not installed.
    """
    try:
        import imageio.v2
        import imageio_ffmpeg  # noqa: F401
    except ImportError as error:
        raise InputError(
            f"a video needs imageio: pip install 'pbd-warp[video]' ({error}); an .html needs nothing"
        ) from None
    return imageio.v2


def save_video(
    drawn: Drawn,
    x: np.ndarray,
    fps: float,
    path: str | os.PathLike[str],
    on_frame: Callable[[int, int], object] = lambda done, of: None,
) -> None:
    """Draw the frames x [frame_count, particle_count, 3] into a file that ends in .mp4 or .gif.

    Where there are more frames a second than a video of that kind should have, it has as many as it should, at the
    same pace.
    """
    out = Path(path)
    rate = min(fps, GIF_RATE if out.suffix == ".gif" else MP4_RATE)
    shown = np.unique(np.rint(np.arange(0.0, len(x), fps / rate)).astype(int).clip(max=len(x) - 1))
    renderer = Renderer(drawn, drawn.around(x), *SIZE[out.suffix])
    options = {"loop": 0, "duration": 1e3 / rate} if out.suffix == ".gif" else {"fps": rate, "quality": 7}
    with imageio().get_writer(out, **options) as video:
        for done, frame in enumerate(shown, 1):
            video.append_data(renderer.draw(x[frame], frame / fps))
            on_frame(done, len(shown))
