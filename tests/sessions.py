"""Sessions without a network, and what tests do with them."""

import numpy as np
from pxr import Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.grab.recording import Recording
from pbd_warp.run import Checkpoints, Hooks, run
from pbd_warp.view import messages as say
from pbd_warp.view.session import Session


def open_scene(name, **options):
    scene = pbd.load_scene(name, options.get("seed"), options.get("parameters"))
    session = Session(scene, name, **options)
    session.begin()
    return session


def select(session, particle, who=1):
    """As a page does that shows the newest frame."""
    session.do(who, say.Select(particle, session.frame, session.generation))


def position(session, particle):
    return session.positions()[particle].astype(np.float64)


def off(place, x, y):
    """A place beside another one, in the picture's plane."""
    return np.add(place, (x, y, 0.0))


def move(session, place, who=1):
    session.do(who, say.Move(tuple(map(float, place))))


def change(session, **changes):
    session.do(1, say.Change(changes))


def replayed(recording, source, folder, stop=None):
    """Positions of every frame that `run` writes from a recording, maybe in two goes: float32 [frames, n, 3]."""
    path = folder / "drags.json"
    recording.save(path)
    recording = Recording.load(path)
    scene = recording.load_scene(source)
    checkpoint = folder / "checkpoint.npz"
    for frames in (stop, recording.frames) if stop else (recording.frames,):
        scene = scene.changed(frames=frames)
        hooks = Hooks(checkpoints=Checkpoints(checkpoint, every=9, resume=checkpoint.exists()) if stop else None)
        run(scene, folder / "again.usdc", dtype=recording.dtype, hooks=hooks, recording=recording)
    stage = Usd.Stage.Open(str(folder / "again.usdc"))
    points = UsdGeom.Points.Get(stage, "/World/Particles").GetPointsAttr()
    return np.array([points.Get(frame) for frame in range(recording.frames)])


class Film:
    """The positions that a session sends, frame by frame since its initial state."""

    def __init__(self, session):
        self.session = session
        self.frames = [session.positions()]

    def roll(self, count, each=lambda k: None):
        for k in range(count):
            each(k)
            assert self.session.advance()
            self.frames.append(self.session.positions())
        return self
