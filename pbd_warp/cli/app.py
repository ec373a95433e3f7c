"""The Typer application that commands add themselves to."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from pbd_warp.errors import InputError
from pbd_warp.scene import parameters_text, scene_names, scene_text
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


class SceneCommand(TyperCommand):
    """A command whose help tells the parameters of the scene that stands before --help."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        ctx.meta["given"] = list(args)
        return super().parse_args(ctx, args)

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        for name in ctx.meta.get("given", ()):
            if name in scene_names() or (name.endswith(".py") and Path(name).is_file()):
                self._format_parameters(name, formatter)
        super().format_epilog(ctx, formatter)

    def _format_parameters(self, name: str, formatter: Any) -> None:
        try:
            text, about = parameters_text(name), scene_text(name).replace("`", "")
        except InputError as error:  # a file that fails to import must not take the help with it
            text, about = str(error), ""
        with formatter.section(f"Parameters of {name} (--set NAME=VALUE)"):
            formatter.write_text(text or "none")
            if about:
                formatter.write_text(about)


def command(name: str, *examples: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator: a command of the application, with the whole first paragraph of its docstring as its summary, and
    examples at the end of its help."""
    shown = "\n".join(f"  pbd-warp {example}" for example in examples)

    def add(function: Callable[..., Any]) -> Callable[..., Any]:
        summary = " ".join((inspect.getdoc(function) or "").split("\n\n")[0].split())
        kind = SceneCommand if "scene" in inspect.signature(function).parameters else TyperCommand
        return app.command(name, cls=kind, short_help=summary, epilog=f"Examples:\n\n\b\n{shown}")(function)

    return add
