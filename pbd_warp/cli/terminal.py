"""How a command talks to a terminal: errors, Ctrl-C."""

from __future__ import annotations

import os
import re
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import typer

from pbd_warp.cli.options import SETTINGS
from pbd_warp.errors import InputError, Interrupted, PbdError
from pbd_warp.usd.errors import reason


def as_options(sentence: str) -> str:
    """A sentence with settings as the command line spells them: on_failure='subdivide' is --on-failure subdivide."""
    name = "|".join(SETTINGS)

    def option(match: re.Match[str]) -> str:
        return f"--{match[1].replace('_', '-')} {match[3]}"

    outside = re.split(r"(\([^()]*\))", sentence)  # what stands in brackets is how a method prints itself
    outside[::2] = [re.sub(rf"\b({name})=('?)([\w.-]*\w)\2", option, part) for part in outside[::2]]
    return "".join(outside).replace("give Simulation or Scene --", "give --")


@contextmanager
def one_sentence(debug: bool) -> Iterator[None]:
    """Errors become what, where, what helps and what is kept, a line each on stderr, and an exit code: 2 bad usage, 1
    the run failed, 130 Ctrl-C.

    Below it nothing ends in a traceback, unless `debug` asks for one.
    """
    try:
        yield
    except typer.Exit:
        raise
    except (Exception, KeyboardInterrupt) as error:
        if debug:
            traceback.print_exc()
        lines, code = _told(error)
        warn(*lines)
        raise typer.Exit(code) from None


def _told(error: BaseException) -> tuple[list[str], int]:
    """What an error says, line by line, and the exit code."""
    if isinstance(error, KeyboardInterrupt):
        return ["interrupted"], 130
    if isinstance(error, PbdError):
        return error.lines, 2 if isinstance(error, InputError) else 130 if isinstance(error, Interrupted) else 1
    if isinstance(error, OSError):
        return [str(error)], 1
    if isinstance(error, MemoryError) or "failed to allocate" in str(error).lower():
        return ["there is not enough memory for this", "helps: make the scene smaller, or ask for fewer contacts"], 1
    what = (reason(error).strip() or "no more is known").splitlines()[0]
    return [f"{type(error).__name__}: {what} (this should have been a clearer sentence; --debug says where)"], 1


def tell(text: str) -> None:
    """Print to stdout. Nobody may be reading: what was asked for is done all the same."""
    try:
        typer.echo(text)
        sys.stdout.flush()
    except BrokenPipeError:
        # Python flushes stdout once more when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except UnicodeEncodeError:
        typer.echo(text.encode("ascii", "backslashreplace").decode())


def warn(sentence: str, *others: str) -> None:
    """Print to stderr, with options as they are spelled here, and whatever is no text as an escape.

    Args:
        others: Lines that belong to the first, shown below it.
    """
    for line in (f"pbd-warp: {sentence}", *(f"  {other}" for other in others)):
        escaped = (c if c.isprintable() else c.encode("unicode_escape").decode() for c in as_options(line))
        with suppress(OSError):
            typer.echo("".join(escaped), err=True)


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
