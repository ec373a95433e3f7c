"""The Typer application that commands add themselves to."""

from __future__ import annotations

import typer

app = typer.Typer(
    help="Position-based dynamics on NVIDIA Warp.", no_args_is_help=True, add_completion=False, rich_markup_mode=None
)
