"""Animations in chunks: what lies on disk while they grow, and the one file that they end as."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom, Vt

from pbd_warp.animation import CHUNK, Animation

SUFFIXES = (".usda", ".usdc", ".usd")
POINTS = 7


def values(frame):
    """Other numbers in each frame, none of them representable in few digits."""
    x = np.random.default_rng(frame).normal(size=(POINTS, 3)).astype(np.float32)
    return [Vt.Vec3fArray.FromNumpy(x), Vt.Vec3fArray.FromNumpy(x[:2] * 3)]


def animate(path, resume=None, times=float, **kwargs):
    """An animation of two attributes of one prim, one of them below another root."""
    stage = Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(60)
    curves = UsdGeom.BasisCurves.Define(stage, "/Set/Ropes")
    curves.CreateWidthsAttr([0.25])
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Set"))
    other = UsdGeom.Points.Define(stage, "/Other/Deep/Points")
    return Animation(path, stage, [curves.CreatePointsAttr(), other.CreateVelocitiesAttr()], resume, **kwargs)


def write(animation, frames, time_code=float):
    for frame in range(animation.frames, frames):
        animation.write(values(frame), time_code(frame))
    return animation


def assert_holds(path, frames, time_code=float):
    """Exactly these frames, bit for bit, through USD's own composition."""
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


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_chunk_is_on_disk_and_in_the_unfinished_stage(tmp_path, suffix):
    animation = write(animate(tmp_path / f"a{suffix}"), CHUNK - 1)
    assert names(tmp_path) == [], "what is shorter than a chunk is in memory"
    for frames in range(CHUNK, 3 * CHUNK + 2):
        write(animation, frames)
        assert names(tmp_path) == ["a.partial.frames", f"a.partial{suffix}"]
        if frames % CHUNK < 2:
            assert_holds(tmp_path / f"a.partial{suffix}", frames // CHUNK * CHUNK)
    animation.close()
    assert names(tmp_path) == [f"a{suffix}"]
    assert_holds(animation.saved, 3 * CHUNK + 1)


def test_between_chunks_the_motion_goes_on_evenly(tmp_path):
    write(animate(tmp_path / "a.usdc"), 2 * CHUNK)
    stage = Usd.Stage.Open(str(tmp_path / "a.partial.usdc"))
    before, after = (np.array(values(frame)[0]) for frame in (CHUNK - 1, CHUNK))
    between = np.array(stage.GetAttributeAtPath("/Set/Ropes.points").Get(CHUNK - 0.25))
    np.testing.assert_allclose(between, 0.25 * before + 0.75 * after, atol=1e-6)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("frames", [1, CHUNK - 1, CHUNK, CHUNK + 1, 3 * CHUNK + 5])
def test_resumed_equals_uninterrupted_byte_for_byte(tmp_path, suffix, frames):
    write(animate(tmp_path / f"whole{suffix}"), frames).close()
    expected = (tmp_path / f"whole{suffix}").read_bytes()
    for done in {1, frames // 2, frames - 1, frames, frames // CHUNK * CHUNK} - {0}:
        path = tmp_path / str(done) / f"whole{suffix}"
        path.parent.mkdir()
        killed = write(animate(path), min(done + 3, frames))
        killed.flush()
        del killed
        resumed = animate(path, resume=done)
        assert resumed.frames == done
        assert_holds(path.with_name(f"whole.partial{suffix}"), done)
        write(resumed, frames).close()
        assert path.read_bytes() == expected
        assert names(path.parent) == [path.name]
