"""Real time: when the next frame is due, and whether the simulation keeps up."""

from __future__ import annotations

from collections import deque

WINDOW = 2.0
"""What was is judged over the last so many seconds."""

SLACK = 0.1
"""A simulation later than this [s] is behind: what it has missed is dropped, not caught up with."""

KEEPS_UP = 0.95
"""Of the frames that were due, that make a simulation one that keeps up."""


class Pace:
    """Frames at a rate, in real time. Times are those of any one clock [s].

    Args:
        fps: Frames a second.
        now: When the first is due.
    """

    def __init__(self, fps: float, now: float):
        self.fps = fps
        self.due = now
        self._begun = now
        self._done: deque[float] = deque()

    def made(self, now: float) -> None:
        """A frame has been made: when is the next one due?"""
        self.due = max(self.due + 1.0 / self.fps, now - SLACK)
        self._done.append(now)
        while self._done[0] < now - WINDOW:
            self._done.popleft()

    def speed(self, now: float) -> float | None:
        """Simulated over real time, None before that can be said."""
        since = max(now - WINDOW, self._begun)
        if now - since < 0.5 * WINDOW:
            return None
        return sum(time > since for time in self._done) / (self.fps * (now - since))

    def keeps_up(self, now: float) -> bool:
        speed = self.speed(now)
        # One frame more or less within the window is no delay.
        return speed is None or speed + 1.0 / (self.fps * WINDOW) >= KEEPS_UP
