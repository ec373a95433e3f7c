"""Cores of this machine: how many there are, and keeping what is timed on one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


def cores() -> int:
    """Cores that this process may use."""
    return len(own_cores() or ()) or os.cpu_count() or 1


def own_cores() -> list[int] | None:
    """Numbers of the cores that this process may use, where processes can be kept on one."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None


@contextmanager
def alone_on_a_core() -> Iterator[None]:
    """Keeps this thread on one core, so that what it times is not moved about."""
    before = own_cores()
    if before is None:
        yield
        return
    os.sched_setaffinity(0, {before[-1]})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
