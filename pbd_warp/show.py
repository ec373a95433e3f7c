"""Shows anything that can be seen."""

from __future__ import annotations

import asyncio
import contextlib
import os
import webbrowser
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from pbd_warp.errors import InputError
from pbd_warp.grab.controller import play
from pbd_warp.grab.drag import Drag
from pbd_warp.model.builder import DTYPES, ModelBuilder, find_device
from pbd_warp.model.model import Model
from pbd_warp.player.motion import Motion, in_notebook
from pbd_warp.player.playable import Playable
from pbd_warp.player.stage import read_motion
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.view.server import ViewServer
from pbd_warp.view.session import Session


def show(what: Scene | ModelBuilder | Model | Simulation | Motion | str | os.PathLike[str]) -> None:
    """Show a scene, a builder, a model or a simulation (as it is now) live, where the mouse leads particles, until
    Ctrl-C; a motion, or a USD file by its path, as a player. In Jupyter all are players within the notebook, of a model
    or a simulation for the next five seconds.

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
            _open(Session(scene, scene.name))
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


class _Finished(ModelBuilder):
    """A model as a scene has it: what a simulation is of, as it is now. Nothing can be added to it."""

    def __init__(self, model: Model):
        super().__init__(model.gravity)
        self._model, self.particle_count = model, model.particle_count

    def finalize(self, device: str | wp.Device | None = None, dtype: str = "float32") -> Model:
        return replace(self._model, device=find_device(device), real=DTYPES[dtype])

    def add_particles(self, *given: Any, **more: Any) -> range:
        raise InputError("nothing can be added to a simulation that is shown: show a scene or a builder")


def _open_simulation(sim: Simulation) -> None:
    """The live view on a simulation, which stays where it is."""
    point = sim.model.point
    if sim.point_target is not None:
        point = replace(point, target=sim.point_target.numpy().astype(np.float64))
    x, v = sim.positions.astype(np.float64), sim.velocities.astype(np.float64)
    v[sim.model.w == 0.0] = 0.0  # those move as they are told, and nobody tells them here
    now = replace(sim.model, x=x, v=v, point=point)
    scene = Scene(_Finished(now), settings=sim.settings, name="simulation")
    _open(Session(scene, scene.name, str(now.device), now.dtype))


Playable.open_live = _open_simulation


def _open(session: Session) -> None:
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_live(session))


async def _live(session: Session) -> None:
    server = ViewServer(session)
    await server.start()
    try:
        print(f"{session.scene.name} is live at {server.url} (Ctrl-C ends it)")
        webbrowser.open(server.url)
        await asyncio.Event().wait()
    finally:
        await server.stop()
