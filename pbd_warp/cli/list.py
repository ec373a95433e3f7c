"""pbd-warp list."""

from __future__ import annotations

import typer

from pbd_warp.cli.app import command
from pbd_warp.scene import scene_names, scene_summary


@command("list", "list")
def list_scenes() -> None:
    """List the scenes."""
    for name in scene_names():
        typer.echo(f"{name:15} {scene_summary(name)}")
