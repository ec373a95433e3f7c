"""pbd-warp info."""

from __future__ import annotations

from typing import Any

from pbd_warp.cli.app import command
from pbd_warp.cli.options import Debug, Device, Dtype, SceneName, Seed, Set, scene_with, takes_settings
from pbd_warp.cli.terminal import one_sentence, tell, warn
from pbd_warp.cost import cost_sheet, too_much
from pbd_warp.scene import parameters_text
from pbd_warp.simulation import Simulation


@command("info", "info rope", "info chain --set links=50 --method jacobi")
@takes_settings
def info(
    scene: SceneName,
    device: Device = None,
    dtype: Dtype = None,
    seed: Seed = None,
    set_: Set = None,
    debug: Debug = False,
    *,
    changes: dict[str, Any],
) -> None:
    """Show what a frame of a scene costs: passes, launches, memory."""
    with one_sentence(debug):
        built = scene_with(scene, changes, seed, set_)
        model = built.builder.finalize(device=device, dtype=dtype or "float32")
        sentence = too_much(model, built.settings)
        if sentence:
            warn(sentence)
        sheet = cost_sheet(Simulation(model, built.settings))
        tell(f"scene            {built.name}, {model.dtype} on {model.device}, {built.settings.method}")
        tell(f"parameters       {parameters_text(scene) or 'none'}\n{sheet}")
