"""pbd-warp info."""

from __future__ import annotations

import typer

from pbd_warp.cli.app import app
from pbd_warp.cli.options import (
    Debug,
    Device,
    Dtype,
    Fps,
    Integrator,
    Iterations,
    Method,
    SceneName,
    Seed,
    Set,
    Substeps,
    Tolerance,
    scene_with,
)  # fmt: skip
from pbd_warp.cli.terminal import one_sentence
from pbd_warp.cost import cost_sheet
from pbd_warp.run import make_simulation


@app.command()
def info(
    scene: SceneName,
    fps: Fps = None,
    device: Device = None,
    dtype: Dtype = None,
    method: Method = None,
    iterations: Iterations = None,
    substeps: Substeps = None,
    integrator: Integrator = None,
    tolerance: Tolerance = None,
    seed: Seed = None,
    set_: Set = None,
    debug: Debug = False,
) -> None:
    """Show what a frame of a scene costs: passes, launches, memory."""
    with one_sentence(debug):
        built = scene_with(scene, None, fps, method, iterations, substeps, integrator, tolerance, seed, set_)
        model = built.builder.finalize(device=device, dtype=dtype or "float32")
        typer.echo(f"scene            {built.name}, {model.dtype} on {model.device}, {built.method}")
        typer.echo(cost_sheet(make_simulation(built, model)))
