"""How far something long has got: a bar on a terminal, a line every ten seconds anywhere else."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

LINE_EVERY = 10.0
"""Seconds between two lines."""


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[..., None]]:
    """Gives a function of how many are done, of how many, and of what is being done. What it says goes to stderr."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield _lines(title)
        return
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, of, doing="": progress.update(
            task, completed=done, total=of, description=f"{title} {doing}".strip()
        )


def _lines(title: str, clock: Callable[[], float] = time.monotonic) -> Callable[..., None]:
    """Prints a line where the last one, or the start, was ten seconds ago."""
    start = last = clock()

    def advance(done: int, of: int | None, doing: str = "") -> None:
        nonlocal last
        now = clock()
        if now - last < LINE_EVERY:
            return
        last = now
        far = f"{title} {doing}: {done}" if doing else f"{title}: {done}"
        if of is None:
            print(f"{far} after {now - start:.0f} s", file=sys.stderr, flush=True)
            return
        left = (now - start) * (of - done) / max(done, 1)
        print(f"{far} of {of} after {now - start:.0f} s, some {left:.0f} s to go", file=sys.stderr, flush=True)

    return advance
