"""What is said when the system has nothing left for another connection: asyncio would print a traceback at each try."""

from __future__ import annotations

import asyncio
import errno
import sys
import time
from collections.abc import Callable
from typing import Any

SHORT = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
SAID_EVERY = 60.0  # s
RETRIED_WITHIN = 10.0  # s: asyncio waits one, on a machine that has time


class Shortage:
    """Handles exceptions of an event loop: a line a minute at most about connections that could not be accepted,
    everything else as asyncio does."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._next = clock()
        self._tries_again = -float("inf")  # until then asyncio may listen again, at a socket that is closed by now too

    def __call__(self, loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if isinstance(error, ValueError) and "descriptor: -1" in str(error) and self._clock() < self._tries_again:
            return
        if not isinstance(error, OSError) or error.errno not in SHORT:
            loop.default_exception_handler(context)
            return
        now = self._clock()
        self._tries_again = now + RETRIED_WITHIN
        if now < self._next:
            return
        self._next = now + SAID_EVERY
        reason = error.strerror or error
        print(f"pbd-warp: a page could not be let in: {reason}; close others (ulimit -n)", file=sys.stderr, flush=True)
