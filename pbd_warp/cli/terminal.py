"""How a command talks to a terminal: errors, Ctrl-C."""

from __future__ import annotations

import signal
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import typer

from pbd_warp.errors import InputError, Interrupted, PbdError


@contextmanager
def one_sentence(debug: bool) -> Iterator[None]:
    """Errors become what, where, what helps and what is kept, a line each; and an exit code: 2 bad usage, 1 the run
    failed, 130 Ctrl-C."""
    try:
        yield
    except (PbdError, OSError) as error:
        if debug:
            traceback.print_exc()
        complain(error.lines if isinstance(error, PbdError) else [str(error)])
        code = 2 if isinstance(error, InputError) else 130 if isinstance(error, Interrupted) else 1
        raise typer.Exit(code) from None


def complain(lines: Sequence[str]) -> None:
    """What is wrong, to stderr: a line each, those after the first indented."""
    first, *others = lines
    for line in (f"pbd-warp: {first}", *(f"  {line}" for line in others)):
        typer.echo(line, err=True)


@contextmanager
def interruptible() -> Iterator[Callable[[], None]]:
    """Ctrl-C is noted, and acted on where the function that this gives is called: between two frames.

    Python would raise it wherever it happens to be, and drop it where that is a destructor. A second Ctrl-C does.
    """
    asked: list[int] = []
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: object) -> None:
        asked.append(number)
        signal.signal(signal.SIGINT, before)

    def stop_if_asked() -> None:
        if asked:
            raise KeyboardInterrupt

    signal.signal(signal.SIGINT, note)
    try:
        yield stop_if_asked
    finally:
        signal.signal(signal.SIGINT, before)
