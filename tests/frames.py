"""Animations whose every frame is known, and whether a file holds them."""

import numpy as np
from pxr import Usd, UsdGeom, Vt

from pbd_warp.usd.animation import Animation

POINTS = 7


def values(frame):
    """Other numbers in each frame, none of them short in decimals."""
    x = np.random.default_rng(frame).normal(size=(POINTS, 3)).astype(np.float32)
    return [Vt.Vec3fArray.FromNumpy(x), Vt.Vec3fArray.FromNumpy(x[:2] * 3)]


def animate(path, resume=None, **kwargs):
    """An animation of two attributes, below two root prims."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(60)
    curves = UsdGeom.BasisCurves.Define(stage, "/Set/Ropes")
    curves.CreateWidthsAttr([0.25])
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Set"))
    other = UsdGeom.Points.Define(stage, "/Other/Deep/Points")
    return Animation(path, stage, [curves.CreatePointsAttr(), other.CreateVelocitiesAttr()], resume, **kwargs)


def write(animation, frames, time_code=float):
    """Go on until there are so many frames."""
    for frame in range(animation.frames, frames):
        animation.write(values(frame), time_code(frame))
    return animation


def assert_holds(path, frames, time_code=float):
    """Exactly these frames, bit for bit, as USD composes them."""
    stage = Usd.Stage.Open(str(path))
    times = [time_code(frame) for frame in range(frames)]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (times[0], times[-1])
    assert stage.GetTimeCodesPerSecond() == 60
    assert UsdGeom.BasisCurves.Get(stage, "/Set/Ropes").GetWidthsAttr().Get() == Vt.FloatArray([0.25])
    for number, name in enumerate(["/Set/Ropes.points", "/Other/Deep/Points.velocities"]):
        attribute = stage.GetAttributeAtPath(name)
        assert attribute.GetTimeSamples() == times
        for frame, time in enumerate(times):
            assert attribute.Get(time) == values(frame)[number]


def names(folder):
    return sorted(path.name for path in folder.iterdir())
