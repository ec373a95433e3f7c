"""pbd-warp list."""

from __future__ import annotations

from pbd_warp.cli.app import command
from pbd_warp.cli.options import Debug
from pbd_warp.cli.terminal import one_sentence, tell
from pbd_warp.scene import scene_names, scene_summary


@command("list", "list")
def list_scenes(debug: Debug = False) -> None:
    """List the scenes."""
    with one_sentence(debug):
        tell("\n".join(f"{name:15} {scene_summary(name)}" for name in scene_names()))
