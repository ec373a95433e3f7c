"""Recordings: the same motion again, to the last bit, and files that are refused."""

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from models import FOUR_SCENES
from sessions import Film, change, move, off, open_scene, position, replayed, select

import pbd_warp as pbd
from pbd_warp.grab.drawing import DrawnRope
from pbd_warp.grab.grabber import Grabber
from pbd_warp.grab.recording import Recording
from pbd_warp.run import run
from pbd_warp.view import messages as say
from pbd_warp.view.changes import GRAB_ACCELERATION


@pytest.mark.parametrize("acceleration", [GRAB_ACCELERATION, None])
@pytest.mark.parametrize("name", FOUR_SCENES)
def test_a_recording_replays_bit_for_bit(name, acceleration, tmp_path):
    """Hold, lead, let go, change settings while holding and while free, take another: the USD file has exactly the
    positions that were sent."""
    session = open_scene(name)
    change(session, grab_acceleration=acceleration)
    film = Film(session).roll(12)
    last = len(session.positions()) - 1
    select(session, last)
    at = position(session, last)
    film.roll(15, lambda k: move(session, off(at, -0.02 * k, 0.012 * k)))
    change(session, substeps=7, iterations=5)
    film.roll(5, lambda k: move(session, off(at, -0.3, 0.18 - 0.016 * k)))
    film.roll(3)  # held, not moved
    session.do(1, say.Release())
    change(session, gravity=(0.5, -3.0, 0.0), method="jacobi" if name != "collision" else "gauss-seidel")
    film.roll(5)
    if name != "collision":
        change(session, stiffness=0.6, damping=0.0)
        film.roll(5)
    select(session, 0)
    session.do(1, say.Release())
    select(session, 0)
    start = position(session, 0)
    film.roll(5, lambda k: move(session, off(start, 0.004 * k, 0)))
    assert session.grabber.particle == 0
    assert session.frame + 1 == len(film.frames) == session.recording.frames
    again = replayed(session.recording, name, tmp_path)
    assert again.dtype == np.float32
    np.testing.assert_array_equal(again, np.array(film.frames))
    assert np.abs(again[-1] - again[12]).max() > 0.05, "something has moved"
    # The checkpoint of frame 36 is in the middle of it, after two changes of settings.
    np.testing.assert_array_equal(replayed(session.recording, name, tmp_path, stop=40), again)


@pytest.mark.parametrize(
    ("method", "integrator"), [("direct", "midpoint4"), ("direct", "bdf2"), ("jacobi", "midpoint")]
)
def test_a_recording_of_what_remembers_the_step_before_replays_bit_for_bit(method, integrator, tmp_path):
    session = open_scene("chain", parameters={"links": "5"})
    film = Film(session).roll(3)
    change(session, method=method, integrator=integrator, substeps=4)
    film.roll(6)
    select(session, 3)
    session.do(1, say.Release())  # taken and let go of between two frames: they begin anew
    film.roll(4)
    select(session, 5)
    at = position(session, 5)
    film.roll(8, lambda k: move(session, off(at, -0.004 * k, 0.004 * k)))
    session.do(1, say.Rewind(14))
    session.do(1, say.Pause(False))
    del film.frames[15:]
    film.roll(6)
    np.testing.assert_array_equal(replayed(session.recording, "chain", tmp_path), np.array(film.frames))


@pytest.mark.parametrize("acceleration", [GRAB_ACCELERATION, None])
@pytest.mark.parametrize("particle", [0, 20])
def test_what_goes_on_from_an_earlier_frame_replays_bit_for_bit(particle, acceleration, tmp_path):
    """Back to a frame in which something was held (particle 0 is fixed), with other settings than those of the end."""
    session = open_scene("rope")
    change(session, grab_acceleration=acceleration)
    film = Film(session).roll(5)
    select(session, particle)
    at = position(session, particle)
    film.roll(10, lambda k: move(session, off(at, -0.01 * k, 0.01 * k)))
    change(session, substeps=9)
    film.roll(5, lambda k: move(session, off(at, 0.01 * k, 0)))
    session.do(1, say.Rewind(3))
    session.do(1, say.Rewind(12))
    session.do(1, say.Step())
    assert (session.frame, session.sim.substeps, session.sim.held, session.holder) == (13, 48, None, None)
    del film.frames[13:]
    film.frames.append(session.positions())
    session.do(1, say.Pause(False))
    film.roll(3)
    select(session, 10)
    film.roll(5)
    np.testing.assert_array_equal(replayed(session.recording, "rope", tmp_path), np.array(film.frames))


def test_a_recording_begins_anew_with_a_reset_and_with_another_scene(tmp_path):
    session = open_scene("collision", seed=3)
    select(session, 4)
    Film(session).roll(5, lambda k: move(session, (1.0, 0.5 + 0.01 * k, 0.0)))
    change(session, gravity=(0.0, -2.0, 0.0))
    session.do(1, say.Reset())
    assert (session.frame, session.recording.events, session.grabber.particle, session.holder) == (0, [], None, None)
    film = Film(session).roll(20)
    assert session.recording.seed == 3
    np.testing.assert_array_equal(replayed(session.recording, "collision", tmp_path), np.array(film.frames))
    session.do(1, say.Open("worm", {}, {}))
    assert session.recording.scene == "worm"
    assert session.recording.seed is None
    film = Film(session).roll(3)
    np.testing.assert_array_equal(replayed(session.recording, "worm", tmp_path), np.array(film.frames))
    session.do(1, say.Open("collision", {}, {}))
    assert session.recording.seed == 3
    assert session.settings.gravity is None


def test_what_was_drawn_is_recorded(tmp_path):
    session = open_scene("rope")
    Film(session).roll(5)
    session.do(1, say.Rope(DrawnRope(((-0.5, 0.5, 0), (0, 0.5, 0), (0.5, 0.2, 0)), (0, 2))))
    assert (session.frame, session.model.particle_count) == (0, 21 + 31)
    film = Film(session).roll(30)
    select(session, 30)
    film.roll(5)
    recording = session.recording
    np.testing.assert_array_equal(replayed(recording, "rope", tmp_path), np.array(film.frames))
    session.do(1, say.Reset())
    assert session.recording.ropes == recording.ropes
    session.do(1, say.Open("rope", {}, {}))
    assert session.model.particle_count == 21


@pytest.mark.parametrize(
    ("points", "pinned", "message"),
    [
        (((0, 0, 0),), (), "2 to 100 points, not 1"),
        (((0, 0, 0),) * 101, (), "2 to 100 points, not 101"),
        (((0, 0, 0), (0, 0, 0), (1, 0, 0)), (), "points 0 and 1 of the rope are at one place"),
        (((0, 0, 0), (1, 0, 0)), (2,), "pinned names point 2 of 2"),
        (((0, 0, 0), (1, 0, 0)), (True,), "pinned names point"),
        (((0, 0, 0), (1, 0, np.nan)), (), "finite"),
    ],
)
def test_ropes_that_make_no_sense_are_refused(points, pinned, message):
    with pytest.raises(pbd.InputError, match=message):
        DrawnRope(points, pinned)


def test_a_drawn_rope_goes_through_its_points_with_even_links():
    rope = DrawnRope(((0, 0, 0), (1, 0, 0), (1, 2, 0)), (1,))
    x, pinned = rope.particles()
    links = np.linalg.norm(np.diff(x, axis=0), axis=1)
    assert len(links) == 30
    np.testing.assert_allclose(links, 0.1, rtol=1e-12)
    np.testing.assert_array_equal(x[pinned], [(1, 0, 0)])


def test_a_recording_of_version_0_1_replays(tmp_path):
    """Made by version 0.1, and where its particles were in the end."""
    recording = Recording.load(Path(__file__).parent / "data" / "drags_0.1.json", "worm")
    assert recording.settings.grab_acceleration is None, "its grab was exact"
    x = replayed(recording, "worm", tmp_path)
    assert len(x) == 27
    expected = [(0.32953328, 0.22605091, 0), (0.28046694, 0.23565333, 0), (0.08470563, 0.05040476, 0)]
    # To rounding: half an epsilon of 1 m in each of 32 steps of 26 frames.
    np.testing.assert_allclose(x[-1][[0, 1, 12]], expected, atol=32 * 26 * 6e-8)


def recording_of(scene="worm"):
    session = open_scene(scene)
    select(session, 0)
    move(session, (0.0, -0.02, 0.0))
    session.advance()
    change(session, substeps=3)
    session.advance()
    return session.recording


def test_a_recording_comes_back_as_it_was(tmp_path):
    recording = recording_of()
    recording.save(tmp_path / "drags.json")
    assert Recording.load(tmp_path / "drags.json") == recording
    assert [p.name for p in tmp_path.iterdir()] == ["drags.json"]


def test_a_recording_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "drags.json"
    recording = recording_of()
    recording.save(path)
    old = path.read_text()

    def full(descriptor):
        raise OSError("No space left on device")

    monkeypatch.setattr("os.fsync", full)
    recording.frames = 99
    with pytest.raises(pbd.SimulationFailed, match=r"drags\.json could not be written"):
        recording.save(path)
    assert path.read_text() == old
    assert [p.name for p in tmp_path.iterdir()] == ["drags.json"]


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: d.pop("events"), "it must have"),
        (lambda d: d.update(more=1), "it must have"),
        (lambda d: d.update(scene=3), "scene must be a text"),
        (lambda d: d["settings"].update(dt=0), "dt must be"),
        (lambda d: d.update(frames=0), "frames must be at least 1"),
        (lambda d: d.update(seed="a"), "seed must be a whole number"),
        (lambda d: d.update(events={}), "events must be a list"),
        (lambda d: d["events"].append([9, "push", 1]), "none of select, move, deselect, settings"),
        (lambda d: d["events"].append([0, "deselect", None]), "goes forward"),
        (lambda d: d["events"].append([9, "move", [0, 0, None]]), "position must be"),
        (lambda d: d["events"].append([9, "select", -1]), "at least 0"),
        (lambda d: d["events"].append([9, "select"]), "must be .frame, what, value."),
        (lambda d: d["events"].insert(0, [0, "move", [0, 0, 0]]), "move without a selected particle"),
        (lambda d: d["events"].append([9, "settings", {"substeps": 3}]), "settings must have"),
        (lambda d: d["settings"]["method"].update(name="newton"), "unknown method"),
        (lambda d: d["settings"]["method"].update(speed=3), "does not take"),
        (lambda d: d["settings"].update(method=3), "unknown method"),
        (lambda d: d["settings"].update(gravity=[1, 2]), "gravity"),
        (lambda d: d["settings"]["limits"].update(stretch="1e9"), "limit of stretch must be a number, not '1e9'"),
        (lambda d: d["settings"]["method"].update(tolerance="1"), "tolerance must be a number, not '1'"),
        (lambda d: d["settings"].update(dt="0.01"), "dt must be a number"),
        (lambda d: d["settings"].update(grab_acceleration=-1), "grab_acceleration must be"),
        (lambda d: d.update(model=3), "model must be a table"),
        (lambda d: d.update(ropes=3), "ropes must be a list"),
        (lambda d: d.update(ropes=[{"points": [[0, 0, 0]], "pinned": []}]), "2 to 100 points"),
    ],
)
def test_a_spoiled_recording_is_refused(spoil, message, tmp_path):
    path = tmp_path / "drags.json"
    recording_of().save(path)
    data = json.loads(path.read_text())
    spoil(data)
    path.write_text(json.dumps(data))
    with pytest.raises(pbd.InputError, match=message):
        Recording.load(path)


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="a device of Linux")
def test_a_device_is_no_recording():
    """It may never end."""
    with pytest.raises(pbd.InputError, match=r"is no recording of drags: .*not an ordinary file"):
        Recording.load(Path("/dev/zero"))


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "[" * 100_000, "\x00"])
def test_what_is_no_recording_is_refused(text, tmp_path):
    path = tmp_path / "drags.json"
    path.write_text(text)
    with pytest.raises(pbd.InputError, match="is no recording of drags"):
        Recording.load(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"integrator": "midpoint", "damping": 0.5}, "event 0: integrator 'midpoint' does not model damping"),
        ({"integrator": "zzz"}, "unknown integrator 'zzz'"),
        ({"integrator": []}, "integrator and on_failure must be texts"),
        ({"substeps": -1}, "substeps must be at least 1"),
        ({"stiffness": 5}, "stiffness must be"),
        ({"method": {"name": []}}, "unknown method"),
    ],
)
def test_settings_that_make_no_sense_are_refused_before_the_first_frame(changes, message, tmp_path):
    session = open_scene("rope")
    change(session, substeps=7)
    session.recording.save(tmp_path / "t.json")
    text = json.loads((tmp_path / "t.json").read_text())
    text["events"][0][2].update(changes)
    (tmp_path / "t.json").write_text(json.dumps(text))
    scene = pbd.load_scene("rope")
    with pytest.raises(pbd.InputError, match=re.escape(message)):
        run(scene, tmp_path / "x.usda", recording=Recording.load(tmp_path / "t.json"))
    assert [path.name for path in tmp_path.iterdir()] == ["t.json"]


def test_a_recording_of_another_scene_is_refused():
    recording = recording_of()
    with pytest.raises(pbd.InputError, match="the drags are of scene worm, not of rope"):
        recording.load_scene("rope")
    scene = pbd.load_scene("worm")
    other = scene.changed(builder=pbd.load_scene("rope").builder)
    with pytest.raises(pbd.InputError, match="not what it was"):
        recording.replay(other, other.builder.finalize())
    recording.events.append((9, "select", 99))
    with pytest.raises(pbd.InputError, match="names particle 99"):
        recording.replay(scene, scene.builder.finalize())


def test_a_recording_knows_its_model_again_in_spite_of_rounding():
    scene = pbd.load_scene("worm")
    model = scene.builder.finalize()
    recording_of().replay(scene, dataclasses.replace(model, x=model.x * (1.0 + 1e-12)))
    with pytest.raises(pbd.InputError, match="not what it was"):
        recording_of().replay(scene, dataclasses.replace(model, x=model.x * (1.0 + 1e-3)))


def test_replays_go_through_the_grabber(monkeypatch):
    recording = recording_of()
    gestures = []
    select = Grabber.select
    monkeypatch.setattr(Grabber, "select", lambda self, p: (gestures.append(p), select(self, p)))
    scene = pbd.load_scene("worm")
    replay = recording.replay(scene, scene.builder.finalize())
    replay.advance(replay.begin())
    assert gestures == [0]
