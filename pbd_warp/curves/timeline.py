"""The frames of a simulation, and where they lie in the time of the stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Usd

from pbd_warp import check
from pbd_warp.errors import InputError

SECONDS = 5.0
"""Simulated where neither the stage nor the user says how long."""

MOST_FRAMES = 1_000_000
"""Four and a half hours at 60 a second: a longer range is a mistake of whoever wrote the stage."""


@dataclass(frozen=True)
class Timeline:
    """The frames: their number, how many there are a second, and the time codes of the stage at which they are.

    note: What is unusual about them, to be told; or empty.
    """

    frames: int
    fps: float
    start: float
    time_codes_per_second: float
    note: str = ""

    def time_code(self, frame: int) -> float:
        if self.fps == self.time_codes_per_second:
            return self.start + frame  # which n * 23.976 / 23.976 is not always
        return self.start + frame * self.time_codes_per_second / self.fps

    @property
    def time_codes(self) -> np.ndarray:
        """Of all frames, shape [frames]."""
        return np.array([self.time_code(frame) for frame in range(self.frames)])


def timeline(stage: Usd.Stage, frames: int | None = None, fps: float | None = None) -> Timeline:
    """A frame at every time code of the stage's range, from the first on. Without a range, or with one of a single
    frame, SECONDS from its start, or from time code 0.

    Args:
        frames: How many instead. fps: How many a second instead of timeCodesPerSecond.
    """
    codes = check.number("timeCodesPerSecond", stage.GetTimeCodesPerSecond(), above=0.0)
    rate = codes if fps is None else check.number("fps", fps, above=0.0)
    start, note = check.number("startTimeCode", stage.GetStartTimeCode()), ""
    if frames is None and stage.HasAuthoredTimeCodeRange():
        end = check.number("endTimeCode", stage.GetEndTimeCode(), low=start)
        frames = _frames((end - start) / codes, rate)
        if frames == 1:
            frames = None
            note = (
                f"the stage's time codes {start:g} to {end:g} are a single frame, so {SECONDS:g} s from there are "
                "simulated; --frames sets another length"
            )
    frames = check.whole("frames", _frames(SECONDS, rate) if frames is None else frames, low=1)
    if frames > MOST_FRAMES:
        raise InputError(f"{frames} frames are more than {MOST_FRAMES}: give the number of them with --frames")
    return Timeline(frames, rate, start, codes, note)


def _frames(seconds: float, rate: float) -> int:
    """A range ends on a frame; rounding must not lose it."""
    return int(np.floor(seconds * rate + 1e-6)) + 1
