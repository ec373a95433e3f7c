"""Runs that are killed, and disks that are full: what was written is still there."""

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from frames import assert_holds, names
from pxr import Sdf, Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.run import run
from pbd_warp.usd.chunks import CHUNK

resource = pytest.importorskip("resource", reason="signals and limits of POSIX")

KILLS = 20
FRAMES = 20 * CHUNK + 7

# The children import what stands beside this file.
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}

KILLED_AT_RANDOM = f"""
import os, random, signal, sys, time
from pathlib import Path
from frames import animate, write

FRAMES = {FRAMES}


def child(path):
    path.parent.mkdir()
    pid = os.fork()
    if pid == 0:
        # How many frames are written, for the parent to know after the kill.
        progress = os.open(path.with_suffix(".count"), os.O_CREAT | os.O_WRONLY)
        with animate(path) as animation:
            for frame in range(FRAMES):
                write(animation, frame + 1)
                os.pwrite(progress, b"%8d" % (frame + 1), 0)
        os._exit(0)
    return pid


folder = Path(sys.argv[1])
for suffix in (".usdc", ".usda"):
    for name in ("warm", "whole"):
        start = time.perf_counter()
        assert os.waitpid(child(folder / f"{{name}}{{suffix}}" / f"a{{suffix}}"), 0)[1] == 0
        whole = time.perf_counter() - start
    chance = random.Random(6)
    for number in range({KILLS} // 2):
        pid = child(folder / f"{{number}}{{suffix}}" / f"a{{suffix}}")
        time.sleep(chance.uniform(0.05, 0.95) * whole)
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
"""


def test_killed_at_random_moments(tmp_path):
    subprocess.run([sys.executable, "-c", KILLED_AT_RANDOM, str(tmp_path)], check=True, timeout=300, env=ENVIRONMENT)
    held = []
    for folder in sorted(tmp_path.iterdir()):
        (count,) = folder.glob("a.count")
        written = int(count.read_text() or 0)
        left = [name for name in names(folder) if not name.startswith(".") and name != "a.count"]
        suffix = folder.suffix
        if f"a{suffix}" in left:
            assert_holds(folder / f"a{suffix}", FRAMES)
            held.append(FRAMES)
        elif f"a.partial{suffix}" in left:
            root = Sdf.Layer.FindOrOpen(str(folder / f"a.partial{suffix}"))
            frames = int(root.endTimeCode) + 1
            assert_holds(folder / f"a.partial{suffix}", frames)
            assert written // CHUNK * CHUNK <= frames
            assert frames % CHUNK == 0 or frames == FRAMES
            held.append(frames)
        else:
            assert written < CHUNK, "nothing is on disk before the first chunk"
            held.append(0)
        for file in (folder / f"a.partial{suffix}.frames").glob("0*.usdc"):
            assert Sdf.Layer.FindOrOpen(str(file)).GetAttributeAtPath("/Set/Ropes.points")
    assert len(held) == KILLS + 4
    assert len(set(held)) > KILLS // 3, "not all at the same moment"


def command(*args):
    return [sys.executable, "-c", "from pbd_warp.cli import main; main()", *map(str, args)]


def assert_same_run(path, frames, expected):
    """The frames of `path` are the first ones of the stage `expected`."""
    stage = Usd.Stage.Open(str(path))
    assert stage.GetEndTimeCode() == frames - 1
    checked = 0
    for prim in stage.Traverse():
        for attribute in prim.GetAttributes():
            if times := attribute.GetTimeSamples():
                assert times == list(range(frames))
                other = expected.GetAttributeAtPath(attribute.GetPath())
                assert all(attribute.Get(time) == other.Get(time) for time in times)
                checked += 1
    assert checked == 6, "points, velocities and extents of the particles and of the ropes"
    assert UsdGeom.Camera.Get(stage, "/World/Camera")


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """1000 frames of the worm."""
    scene = pbd.load_scene("worm").changed(frames=1000)
    path = tmp_path_factory.mktemp("whole") / "worm.usdc"
    run(scene, path)
    return Usd.Stage.Open(str(path))


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_the_command_line_is_killed(tmp_path, suffix, uninterrupted):
    process = subprocess.Popen(command("run", "worm", "--frames", 1000, "--out", tmp_path / f"w{suffix}"))
    for _ in range(600):
        if (tmp_path / f"w.partial{suffix}.frames" / "000002.usdc").exists():
            break
        time.sleep(0.05)
    time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not (tmp_path / f"w{suffix}").exists()
    frames = int(Usd.Stage.Open(str(tmp_path / f"w.partial{suffix}")).GetEndTimeCode()) + 1
    assert frames >= 2 * CHUNK
    assert_same_run(tmp_path / f"w.partial{suffix}", frames, uninterrupted)


# Full disks.


@pytest.fixture
def small_disk(tmp_path):
    """A folder with room for 300 KiB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = shutil.which("mount")
    made = mount and subprocess.run([mount, "-t", "tmpfs", "-o", "size=300k", "none", folder], capture_output=True)
    if not made or made.returncode:
        pytest.skip("may not mount a file system")
    yield folder
    subprocess.run(["umount", folder], check=True)


def limited():
    """No file above 300 KiB, as a disk that is full: an error, not a signal."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (300 << 10, 300 << 10))


def assert_failed_but_kept(result, folder, suffix, uninterrupted):
    assert result.returncode == 1, result.stderr
    message = " ".join(result.stderr.split())
    told = re.search(
        r"could not be written: .*; is the disk full\? kept: the first (\d+) frames are in (\S+)$", message
    )
    assert told, message
    assert told[2] == str(folder / f"a.partial{suffix}")
    assert_same_run(told[2], int(told[1]), uninterrupted)
    assert names(folder) == [f"a.partial{suffix}", f"a.partial{suffix}.frames"]
    return int(told[1])


def test_a_full_disk(small_disk, uninterrupted):
    arguments = command("run", "worm", "--frames", 1000, "--out", small_disk / "a.usdc")
    result = subprocess.run(arguments, capture_output=True, text=True, timeout=300)
    kept = assert_failed_but_kept(result, small_disk, ".usdc", uninterrupted)
    assert kept >= CHUNK
    assert kept % CHUNK == 0
    assert "No space left on device" in result.stderr


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_a_limit_on_the_size_of_a_file(tmp_path, suffix, uninterrupted):
    """The chunks fit, the one file does not."""
    arguments = command("run", "worm", "--frames", 1000, "--out", tmp_path / f"a{suffix}")
    result = subprocess.run(arguments, capture_output=True, text=True, timeout=300, preexec_fn=limited)
    assert assert_failed_but_kept(result, tmp_path, suffix, uninterrupted) == 1000
    assert "File too large" in result.stderr
