"""pbd-warp list."""

from __future__ import annotations

from pbd_warp.cli.app import command
from pbd_warp.cli.options import Debug
from pbd_warp.cli.terminal import one_sentence, tell
from pbd_warp.scene import parameters_text, scene_names, scene_summary


@command("list", "list")
def list_scenes(debug: Debug = False) -> None:
    """List the scenes, with the parameters that --set takes."""
    with one_sentence(debug):
        tell("\n".join(f"{name:15} {scene_summary(name)}{_parameters(name)}" for name in scene_names()))


def _parameters(name: str) -> str:
    text = parameters_text(name)
    return f"\n{'':15}   --set {text}" if text else ""
