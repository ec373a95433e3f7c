"""The Typer application that commands add themselves to."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from pbd_warp.version import __version__

app = typer.Typer(no_args_is_help=True, rich_markup_mode=None)

EXAMPLES = """Examples:

\b
  pbd-warp run rope --out rope.html
  pbd-warp view rope
  pbd-warp COMMAND --help"""


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pbd-warp {__version__}")
        raise typer.Exit


@app.callback(epilog=EXAMPLES)
def pbd_warp(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which version this is.")
    ] = False,
) -> None:
    """Position-based dynamics on NVIDIA Warp."""


def command(name: str, *examples: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator: a command of the application, with the whole first paragraph of its docstring as its summary, and
    examples at the end of its help."""
    shown = "\n".join(f"  pbd-warp {example}" for example in examples)

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        summary = " ".join((inspect.getdoc(function) or "").split("\n\n")[0].split())
        return app.command(name, short_help=summary, epilog=f"Examples:\n\n\b\n{shown}")(function)

    return add
