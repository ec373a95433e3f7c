"""Shows anything that can be seen."""

from __future__ import annotations

import asyncio
import contextlib
import os
import webbrowser
from itertools import chain, islice
from pathlib import Path

from pbd_warp.errors import InputError
from pbd_warp.grab.controller import play
from pbd_warp.grab.drag import Drag
from pbd_warp.model.builder import ModelBuilder
from pbd_warp.model.model import Model
from pbd_warp.player.motion import Motion, in_notebook
from pbd_warp.player.stage import read_motion
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.view.server import ViewServer
from pbd_warp.view.session import Session


def show(what: Scene | ModelBuilder | Model | Simulation | Motion | str | os.PathLike[str]) -> None:
    """Show a scene or a builder live, where the mouse leads particles, until Ctrl-C; anything else as a player: a
    simulation or a model for the next five seconds, a motion, a USD file by its path. In Jupyter all are players within
    the notebook.

    Raises:
        InputError: something else, or what building and simulating it refuse.
        SimulationFailed: it fails within what is to be shown.
    """
    if isinstance(what, (Scene, ModelBuilder)):
        scene = what if isinstance(what, Scene) else Scene(what)
        scene = scene if scene.name else scene.changed(name="scene")
        if in_notebook():
            _motion(scene).show()
        else:
            with contextlib.suppress(KeyboardInterrupt):
                asyncio.run(_live(scene))
    elif isinstance(what, (Model, Simulation)):
        (Simulation(what) if isinstance(what, Model) else what).show()
    elif isinstance(what, Motion):
        what.show()
    elif isinstance(what, (str, os.PathLike)):
        read_motion(Path(what))[0].show()
    else:
        raise InputError(f"show takes a scene, a builder, a model, a simulation, a motion or a file, not {what!r}")


def _motion(scene: Scene) -> Motion:
    """All frames of a scene, with its drag."""
    sim = Simulation(scene.builder, scene.settings)
    drag = Drag(scene.drag)
    drag.check_particles(sim.model.particle_count)
    moving = chain([sim], islice(play(sim, drag, scene.frames), scene.frames - 1))
    seen = [(now.positions, now.tension if now.keeps_forces else None) for now in moving]
    positions, tension = zip(*seen, strict=True)
    return Motion.of(sim.model, positions, scene.fps, scene.name, tension if sim.keeps_forces else None)


async def _live(scene: Scene) -> None:
    server = ViewServer(Session(scene, scene.name))
    await server.start()
    try:
        print(f"{scene.name} is live at {server.url} (Ctrl-C ends it)")
        webbrowser.open(server.url)
        await asyncio.Event().wait()
    finally:
        await server.stop()
