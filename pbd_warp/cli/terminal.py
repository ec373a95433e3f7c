"""How a command talks to a terminal: errors, progress, Ctrl-C."""

from __future__ import annotations

import re
import signal
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from pbd_warp.cli.options import SETTINGS
from pbd_warp.errors import InputError, Interrupted, PbdError


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
    """Errors become one sentence on stderr and an exit code: 2 bad usage, 1 the run failed, 130 Ctrl-C."""
    try:
        yield
    except (PbdError, OSError) as error:
        if debug:
            traceback.print_exc()
        typer.echo(f"pbd-warp: {as_options(str(error))}", err=True)
        code = 2 if isinstance(error, InputError) else 130 if isinstance(error, Interrupted) else 1
        raise typer.Exit(code) from None


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[..., None]]:
    """A progress bar on a terminal, nothing in a pipe; gives a function of how many are done, of how many, and of what
    is being done."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, of, doing="": progress.update(
            task, completed=done, total=of, description=f"{title} {doing}".strip()
        )


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
