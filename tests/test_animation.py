"""Animations in chunks: what lies on disk while they grow, and the one file that they end as."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest
from frames import animate, assert_holds, names, values, write
from pxr import Sdf, Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.identity import Identity
from pbd_warp.usd import merge
from pbd_warp.usd.animation import Animation
from pbd_warp.usd.chunks import CHUNK

SUFFIXES = (".usda", ".usdc", ".usd")


def interrupt(animation, frames):
    """Ctrl-C after so many."""
    try:
        with animation:
            write(animation, frames)
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        pass


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_chunk_is_on_disk_and_in_the_unfinished_stage(tmp_path, suffix):
    animation = write(animate(tmp_path / f"a{suffix}"), CHUNK - 1)
    assert names(tmp_path) == [f".a{suffix}.lock"], "what is shorter than a chunk is in memory"
    for frames in range(CHUNK, 3 * CHUNK + 2):
        write(animation, frames)
        assert names(tmp_path) == [f".a{suffix}.lock", f"a.partial{suffix}", f"a.partial{suffix}.frames"]
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


def test_it_goes_on_from_an_interrupted_or_finished_file_too(tmp_path):
    path = tmp_path / "a.usdc"
    write(animate(path), 70).close()
    expected = path.read_bytes()
    write(animate(path, resume=40), 70).close()
    assert path.read_bytes() == expected
    interrupt(animate(path, resume=33), 50)
    assert names(tmp_path) == ["a.partial.usdc", "a.usdc"]
    assert_holds(tmp_path / "a.partial.usdc", 50)
    resumed = animate(path, resume=45)
    assert_holds(tmp_path / "a.partial.usdc", 45)
    write(resumed, 70).close()
    assert names(tmp_path) == ["a.usdc"]
    assert path.read_bytes() == expected


def test_nothing_to_go_on_from(tmp_path):
    path = tmp_path / "a.usda"
    with pytest.raises(pbd.InputError, match=r"no frames to go on from: neither .*a\.partial\.usda nor .*a\.usda"):
        animate(path, resume=1)
    path.write_text("no USD")
    with pytest.raises(pbd.InputError, match=r"a\.usda cannot be gone on from"):
        animate(path, resume=1)
    Usd.Stage.CreateNew(str(path)).Save()
    with pytest.raises(pbd.InputError, match="holds 0 frames, fewer than the 1"):
        animate(path, resume=1)
    path.unlink()
    write(animate(path), 40).flush()
    with pytest.raises(pbd.InputError, match=r"a\.partial\.usda holds 40 frames, fewer than the 41 to go on from"):
        animate(path, resume=41)
    assert_holds(tmp_path / "a.partial.usda", 40)


def test_flushed_frames_are_on_disk_and_the_file_is_the_same(tmp_path):
    write(animate(tmp_path / "a.usdc"), 50).close()
    flushed = animate(tmp_path / "b.usdc")
    for frames in (1, 2, 20, 32, 33, 50):
        write(flushed, frames).flush()
        assert_holds(tmp_path / "b.partial.usdc", frames)
    assert names(tmp_path / "b.partial.usdc.frames") == ["000000.usdc", "000001.usdc"]
    flushed.close()
    assert (tmp_path / "b.usdc").read_bytes() == (tmp_path / "a.usdc").read_bytes()


def test_flush_tells_when_the_disk_did_not_take_it(tmp_path, monkeypatch):
    animation = write(animate(tmp_path / "a.usdc"), CHUNK - 1)

    def broken(descriptor):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", broken)
    with pytest.raises(pbd.SimulationFailed, match=r"000000\.usdc could not be written: .*Input/output error"):
        animation.flush()


def test_time_codes_of_any_distance(tmp_path):
    def time_code(frame):
        return -5.0 + 0.1 * frame**1.5

    animation = write(animate(tmp_path / "a.usda"), 2 * CHUNK + 3, time_code)
    assert_holds(tmp_path / "a.partial.usda", 2 * CHUNK, time_code)
    with pytest.raises(pbd.InputError, match="is not later than"):
        animation.write(values(0), time_code(2 * CHUNK + 2))
    animation.close()
    assert_holds(tmp_path / "a.usda", 2 * CHUNK + 3, time_code)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_merged_file_is_what_usd_writes_of_the_same_layer(tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(merge, "ELEMENTS_AT_ONCE", 100)
    animation = write(animate(tmp_path / f"a{suffix}"), 3 * CHUNK + 1)
    layer = animation._static(3.0 * CHUNK)
    for path, attribute in [("/Set/Ropes.points", 0), ("/Other/Deep/Points.velocities", 1)]:
        for frame in range(3 * CHUNK + 1):
            layer.SetTimeSample(path, float(frame), values(frame)[attribute])
    animation.close()
    assert Sdf.Layer.FindOrOpen(str(animation.saved)).ExportToString() == layer.ExportToString()
    if suffix == ".usda":
        assert animation.saved.read_text() == layer.ExportToString()


def test_overrides_over_a_sublayer_stay_overrides(tmp_path):
    """What is animated in the sublayer gives way, in the unfinished stage as in the finished one."""
    below = Usd.Stage.CreateNew(str(tmp_path / "set.usda"))
    curves = UsdGeom.BasisCurves.Define(below, "/Set/Ropes")
    curves.CreatePointsAttr([(9, 9, 9)]).Set([(8, 8, 8)], 3)
    UsdGeom.Cube.Define(below, "/Set/Cube")
    below.Save()
    stage = Usd.Stage.CreateInMemory()
    stage.GetRootLayer().subLayerPaths.append("./set.usda")
    over = UsdGeom.BasisCurves(stage.OverridePrim("/Set/Ropes"))
    path = tmp_path / "a.usda"
    animation = Animation(path, stage, [over.CreatePointsAttr()])
    for frame in range(CHUNK):
        animation.write([values(frame)[0]], frame)
    for made in (tmp_path / "a.partial.usda", path):
        opened = Usd.Stage.Open(str(made))
        assert opened.GetPrimAtPath("/Set/Cube").IsDefined()
        points = opened.GetAttributeAtPath("/Set/Ropes.points")
        assert points.GetTimeSamples() == list(range(CHUNK))
        assert points.Get(3) == values(3)[0]
        assert list(opened.GetRootLayer().subLayerPaths) == ["./set.usda"]
        assert not opened.GetRootLayer().GetPrimAtPath("/Set/Cube")
        if made != path:
            animation.close()


def test_the_stage_may_be_edited_until_the_end(tmp_path):
    stage = Usd.Stage.CreateInMemory()
    points = UsdGeom.Points.Define(stage, "/Points").CreatePointsAttr()
    saves = []

    def count():
        saves.append(len(saves))
        UsdGeom.Cube.Define(stage, "/Cube").CreateSizeAttr().Set(float(len(saves)))

    animation = Animation(tmp_path / "a.usda", stage, [points], before_saving=count)
    for frame in range(2 * CHUNK):
        animation.write([values(frame)[0]], frame)
    assert Usd.Stage.Open(str(tmp_path / "a.partial.usda")).GetAttributeAtPath("/Cube.size").Get() == 2.0
    animation.close()
    assert Usd.Stage.Open(str(tmp_path / "a.usda")).GetAttributeAtPath("/Cube.size").Get() == 3.0


def test_a_new_run_takes_the_place_of_a_killed_one_when_it_needs_it(tmp_path):
    path = tmp_path / "a.usdc"
    write(animate(path), 3 * CHUNK)  # and never closed
    write(animate(path), 3).close()
    assert_holds(path, 3)
    assert_holds(tmp_path / "a.partial.usdc", 3 * CHUNK)
    animation = write(animate(path), CHUNK)
    assert_holds(tmp_path / "a.partial.usdc", CHUNK)
    assert names(tmp_path / "a.partial.usdc.frames") == ["000000.usdc"]
    write(animation, CHUNK + 1).close()
    assert names(tmp_path) == ["a.usdc"]


def test_an_interrupted_run_takes_the_place_of_a_killed_one(tmp_path):
    path = tmp_path / "a.usdc"
    write(animate(path), 3).close()
    write(animate(path), CHUNK)
    interrupt(animate(path), 2)
    assert names(tmp_path) == ["a.partial.usdc", "a.usdc"]
    assert_holds(tmp_path / "a.partial.usdc", 2)


def test_only_files_of_the_same_run_are_gone_on_from(tmp_path):
    path = tmp_path / "a.usdc"
    mine, other = (Identity("model", settings, "drags", "") for settings in ("mine", "other"))
    write(animate(path, identity=other), 3 * CHUNK, lambda frame: 2.0 * frame)  # killed, another motion
    message = r"a\.partial\.usdc is of another run, as it differs in settings"
    with pytest.raises(pbd.InputError, match=message):
        animate(path, resume=2, identity=mine)
    write(animate(path, identity=mine), 3).close()
    with pytest.raises(pbd.InputError, match=message + r".*; .*a\.usdc holds 3 frames, fewer than the 4"):
        animate(path, resume=4, identity=mine)
    assert Usd.Stage.Open(str(tmp_path / "a.partial.usdc")).GetEndTimeCode() == 6.0 * CHUNK - 2.0, "nothing was lost"
    resumed = animate(path, resume=2, identity=mine)
    assert_holds(tmp_path / "a.partial.usdc", 2)
    write(resumed, CHUNK + 1).close()
    assert_holds(path, CHUNK + 1)
    assert names(tmp_path) == ["a.usdc"]


def test_a_finished_file_does_not_stand_in_for_an_unfinished_one(tmp_path):
    """However new it is."""
    path = tmp_path / "a.usdc"
    mine, other = (Identity("model", settings, "drags", "") for settings in ("mine", "other"))
    write(animate(path, identity=mine), 2 * CHUNK)
    write(animate(tmp_path / "b.usdc", identity=other), 2 * CHUNK, lambda frame: 2.0 * frame).close()
    os.replace(tmp_path / "b.usdc", path)
    os.utime(path, (2e9, 2e9))
    write(animate(path, resume=40, identity=mine), 50).close()
    assert_holds(path, 50)


@pytest.mark.parametrize("spoil", ["short", "missing", "damaged", "foreign"])
def test_frames_end_at_a_gap(tmp_path, spoil):
    path = tmp_path / "a.usdc"
    mine, other = (Identity(model, "settings", "drags", "") for model in ("mine", "other"))
    write(animate(path, identity=mine), 4 * CHUNK)
    folder = tmp_path / "a.partial.usdc.frames"
    chunk = folder / "000001.usdc"
    if spoil == "missing":
        chunk.unlink()
    elif spoil == "damaged":
        chunk.write_bytes(chunk.read_bytes()[:200])
    elif spoil == "foreign":
        write(animate(tmp_path / "b.usdc", identity=other), 4 * CHUNK)
        os.replace(tmp_path / "b.partial.usdc.frames" / "000001.usdc", chunk)
    else:
        layer = Sdf.Layer.OpenAsAnonymous(str(chunk))
        for name in ("/Set/Ropes.points", "/Other/Deep/Points.velocities"):
            layer.EraseTimeSample(name, CHUNK + 20.0)
        layer.Export(str(chunk))
    there = 2 * CHUNK - 1 if spoil == "short" else CHUNK
    with pytest.raises(pbd.InputError, match=f"holds {there} frames, fewer than the {there + 1} to go on from"):
        animate(path, resume=there + 1, identity=mine)
    write(animate(path, resume=CHUNK, identity=mine), 4 * CHUNK).close()
    assert_holds(path, 4 * CHUNK)


def test_files_of_the_users_own_stay_in_the_folder_of_chunks(tmp_path):
    animation = write(animate(tmp_path / "a.usdc"), CHUNK)
    own = tmp_path / "a.partial.usdc.frames" / "notes.txt"
    own.write_text("mine")
    animation.close()
    assert own.read_text() == "mine"
    write(animate(tmp_path / "a.usdc"), CHUNK + 1).close()
    assert names(tmp_path) == ["a.partial.usdc.frames", "a.usdc"]
    assert names(own.parent) == ["notes.txt"]


@pytest.mark.parametrize("moved", ["folder", "chunks"])
def test_a_folder_that_is_moved_away_is_noticed(tmp_path, moved):
    """USD would make it anew."""
    (tmp_path / "out").mkdir()
    path = tmp_path / "out" / "a.usdc"
    animation = write(animate(path), CHUNK + 1)
    gone = path.parent if moved == "folder" else path.parent / "a.partial.usdc.frames"
    os.rename(gone, tmp_path / "elsewhere")
    with pytest.raises(pbd.SimulationFailed, match="was moved or removed during the run") as caught, animation:
        write(animation, 2 * CHUNK)
    assert "frames are in" not in str(caught.value), "they are not there"
    assert not gone.exists()
    if moved == "folder":
        assert_holds(tmp_path / "elsewhere" / "a.partial.usdc", CHUNK)


@pytest.mark.parametrize("frames", [3, CHUNK])
def test_a_folder_that_is_moved_away_before_anything_is_written(tmp_path, frames):
    (tmp_path / "out").mkdir()
    animation = write(animate(tmp_path / "out" / "a.usdc"), 1)
    os.rename(tmp_path / "out", tmp_path / "elsewhere")
    with pytest.raises(pbd.SimulationFailed, match="was moved or removed during the run"), animation:
        write(animation, frames)
    assert names(tmp_path) == ["elsewhere"]


@pytest.mark.skipif(os.name == "nt", reason="links need a privilege")
def test_what_a_link_leads_to_is_written(tmp_path):
    (tmp_path / "store").mkdir()
    link = tmp_path / "a.usdc"
    link.symlink_to("store/b.usdc")
    animation = write(animate(link), CHUNK)
    assert names(tmp_path / "store") == [".b.usdc.lock", "b.partial.usdc", "b.partial.usdc.frames"]
    animation.close()
    assert link.is_symlink()
    assert names(tmp_path / "store") == ["b.usdc"]
    assert_holds(link, CHUNK)


def test_a_failed_write_may_be_tried_again(tmp_path, monkeypatch):
    animation = write(animate(tmp_path / "a.usdc"), 2 * CHUNK - 1)

    def full(temporary, path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "replace", full)
    for frame in (2 * CHUNK - 1, 2 * CHUNK):
        with pytest.raises(pbd.SimulationFailed, match=r"000001\.usdc could not be written: .*No space left"):
            animation.write(values(frame), frame)
        assert_holds(tmp_path / "a.partial.usdc", CHUNK)
    monkeypatch.undo()
    write(animation, 3 * CHUNK)
    assert_holds(tmp_path / "a.partial.usdc", 3 * CHUNK)
    animation.close()
    assert_holds(tmp_path / "a.usdc", 3 * CHUNK)


def test_two_runs_to_one_path(tmp_path):
    """The path is reserved from the first check to the last rename."""
    path = tmp_path / "a.usdc"
    first = animate(path)
    with pytest.raises(pbd.InputError, match=r"another run is writing to .*a\.usdc"):
        animate(path)
    write(first, CHUNK + 1)
    with pytest.raises(pbd.InputError, match=r"another run is writing to .*a\.usdc"):
        animate(path, resume=3)
    first.close()
    assert names(tmp_path) == ["a.usdc"]
    assert_holds(path, CHUNK + 1)
    animate(path, resume=3)


def test_what_a_killed_write_left_is_removed(tmp_path):
    for name in (".a.0123abcd.new.usdc", ".a.usdc.lock", ".ab.0123abcd.new.usdc"):
        (tmp_path / name).write_text("")
    write(animate(tmp_path / "a.usdc"), 3).close()
    assert names(tmp_path) == [".ab.0123abcd.new.usdc", "a.usdc"], "the third is another file's"


def test_a_disk_that_is_full_at_the_end_keeps_the_chunks_and_says_where(tmp_path, monkeypatch):
    animation = write(animate(tmp_path / "a.usdc"), CHUNK + 5)
    sync = os.fsync

    def full(descriptor):
        if "merged" in os.readlink(f"/proc/self/fd/{descriptor}"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        pbd.SimulationFailed, match=rf"No space left .* the first {CHUNK + 5} frames are in .*a.partial"
    ):
        animation.close()
    assert animation.saved is None
    assert names(tmp_path) == [".a.usdc.lock", "a.partial.usdc", "a.partial.usdc.frames"]
    assert_holds(tmp_path / "a.partial.usdc", CHUNK + 5)
    monkeypatch.undo()
    animation.close()
    assert_holds(tmp_path / "a.usdc", CHUNK + 5)


PEAK_MEMORY = """
import sys
from pathlib import Path
import numpy as np
from pxr import Usd, UsdGeom, Vt
from pbd_warp.usd.animation import Animation

path, points, frames = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
x = np.random.default_rng(0).normal(size=(points, 3)).astype(np.float32)
stage = Usd.Stage.CreateInMemory()
with Animation(path, stage, [UsdGeom.Points.Define(stage, "/Points").CreatePointsAttr()]) as animation:
    for frame in range(frames):
        x[0] = frame
        animation.write([Vt.Vec3fArray.FromNumpy(x)], frame)
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.mark.skipif(not os.path.exists("/proc/self/status"), reason="asks Linux for the peak of resident memory")
@pytest.mark.parametrize(
    ("suffix", "points", "frames", "limit"), [(".usdc", 10_000, (300, 3000), 40), (".usda", 2000, (200, 2000), 8)]
)
def test_memory_does_not_grow_with_the_number_of_frames(tmp_path, suffix, points, frames, limit):
    peak = []
    for count in frames:
        arguments = [sys.executable, "-c", PEAK_MEMORY, str(tmp_path / f"a{suffix}"), str(points), str(count)]
        result = subprocess.run(arguments, capture_output=True, text=True, timeout=300)
        assert result.returncode == 0, result.stderr
        peak.append(int(result.stdout) / 1024)
    assert abs(peak[1] - peak[0]) < limit, "MiB"
