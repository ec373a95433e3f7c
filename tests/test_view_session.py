"""A running scene without any network: what pages can do to it, and that a recording gives the same motion again."""

import dataclasses
import json
import re

import numpy as np
import pytest
from models import FOUR_SCENES
from pxr import Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.grab.camera import Camera
from pbd_warp.grab.grabber import Grabber
from pbd_warp.grab.recording import Recording
from pbd_warp.run import Checkpoints, Hooks, run
from pbd_warp.settings import Settings
from pbd_warp.view import messages as say
from pbd_warp.view.pace import SLACK, Pace
from pbd_warp.view.session import HEADER, Session

CAMERA = Camera((0.0, 0.0, 3.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), 0.8, (800.0, 600.0))


def open_scene(name, **options):
    return Session(pbd.load_scene(name, options.get("seed"), options.get("scene_settings")), name, **options)


def place_of(session, particle):
    x, y = CAMERA.project(session.positions().astype(np.float64))[particle]
    return float(x), float(y)


def click(session, particle, who=1):
    session.do(who, say.Click(CAMERA, place_of(session, particle)))


def move(session, at, who=1):
    session.do(who, say.Move(CAMERA, at))


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
        scene.frames = frames
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


@pytest.mark.parametrize("name", FOUR_SCENES)
def test_a_recording_replays_bit_for_bit(name, tmp_path):
    """Hold, lead, let go, change settings while holding and while free, take another: the USD file has exactly the
    positions that were sent."""
    session = open_scene(name)
    film = Film(session).roll(12)
    last = len(session.positions()) - 1
    click(session, last)
    at = place_of(session, last)
    film.roll(15, lambda k: move(session, (at[0] - 5.0 * k, at[1] + 3.0 * k)))
    change(session, substeps=7, iterations=5)
    film.roll(5, lambda k: move(session, (at[0] - 75.0, at[1] + 45.0 - 4.0 * k)))
    film.roll(3)  # held, not moved
    click(session, last)
    change(session, gravity=(0.5, -3.0, 0.0), method="jacobi" if name != "collision" else "gauss-seidel")
    film.roll(5)
    if name != "collision":
        change(session, stiffness=0.6, damping=0.0)
        film.roll(5)
    click(session, 0)
    click(session, 0)
    click(session, 0)
    film.roll(5, lambda k: move(session, (300.0 + k, 300.0)))
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
    session = open_scene("chain", scene_settings={"links": "5"})
    film = Film(session).roll(3)
    change(session, method=method, integrator=integrator, substeps=4)
    film.roll(6)
    click(session, 3)
    click(session, 3)  # taken and let go of between two frames: they begin anew
    film.roll(4)
    click(session, 5)
    at = place_of(session, 5)
    film.roll(8, lambda k: move(session, (at[0] - k, at[1] + k)))
    np.testing.assert_array_equal(replayed(session.recording, "chain", tmp_path), np.array(film.frames))


def test_a_take_begins_anew_with_a_reset_and_with_another_scene(tmp_path):
    session = open_scene("collision", seed=3)
    click(session, 4)
    Film(session).roll(5, lambda k: move(session, (400.0, 300.0 + k)))
    change(session, gravity=(0.0, -2.0, 0.0))
    session.do(1, say.Reset())
    assert (session.frame, session.recording.events, session.grabber.particle, session.holder) == (0, [], None, None)
    film = Film(session).roll(20)
    assert session.recording.seed == 3
    np.testing.assert_array_equal(replayed(session.recording, "collision", tmp_path), np.array(film.frames))
    session.do(1, say.Load("worm"))
    assert session.recording.scene == "worm"
    assert session.recording.seed is None
    film = Film(session).roll(3)
    np.testing.assert_array_equal(replayed(session.recording, "worm", tmp_path), np.array(film.frames))
    session.do(1, say.Load("collision"))
    assert session.recording.seed == 3
    assert session.settings == Settings.of(pbd.load_scene("collision"))


def test_one_move_a_frame_is_recorded():
    session = open_scene("worm")
    click(session, 0)
    for k in range(5):
        move(session, (400.0 + k, 300.0))
    session.advance()
    move(session, (420.0, 300.0))
    session.advance()
    session.advance()
    assert [(frame, what) for frame, what, _ in session.recording.events] == [(0, "select"), (0, "move"), (1, "move")]


def test_only_one_page_drags_and_what_it_holds_is_free_when_it_goes():
    session = open_scene("worm")
    click(session, 3, who=1)
    assert (session.holder, session.grabber.particle) == (1, 3)
    with pytest.raises(pbd.InputError, match="page 1 is dragging"):
        click(session, 5, who=2)
    before = session.recording.events.copy()
    move(session, (500.0, 300.0), who=2)
    session.do(2, say.Release())
    session.leave(2)
    assert (session.holder, session.grabber.particle, session.recording.events) == (1, 3, before)
    session.leave(1)
    assert (session.holder, session.grabber.particle) == (None, None)
    click(session, 5, who=2)
    assert (session.holder, session.grabber.particle) == (2, 5)
    session.do(2, say.Release())
    assert (session.holder, session.grabber.particle) == (None, None)


def test_the_packet_says_who_holds_whom():
    session = open_scene("worm")
    assert HEADER.unpack(session.packet()[: HEADER.size]) == (1, 0, -1, 0)
    click(session, 3, who=7)
    session.advance()
    packet = session.packet()
    assert HEADER.unpack(packet[: HEADER.size]) == (1, 1, 3, 7)
    x = np.frombuffer(packet[HEADER.size :], np.float32).reshape(-1, 3)
    np.testing.assert_array_equal(x, session.sim.state.x.numpy())
    session.do(1, say.Load("rope"))
    assert HEADER.unpack(session.packet()[: HEADER.size]) == (2, 0, -1, 0)


def test_pause_and_step():
    session = open_scene("rope")
    session.do(1, say.Pause(True))
    assert not session.advance()
    assert session.frame == 0
    session.do(1, say.Step())
    assert session.frame == 1
    assert not session.advance()
    session.do(1, say.Pause(False))
    assert session.advance()
    session.do(1, say.Step())
    assert session.paused, "a step is one frame, not one more"


def test_a_change_of_settings_goes_on_from_the_present_state():
    session = open_scene("rope")
    click(session, 20)
    Film(session).roll(10, lambda k: move(session, (500.0 - k, 300.0)))
    before, velocity, frame = session.sim.state.x.numpy(), session.sim.state.v.numpy(), session.frame
    change(session, iterations=3, substeps=11, gravity=(0.0, 0.0, 0.0))
    assert (session.sim.method.iterations, session.sim.substeps) == (3, 11)
    np.testing.assert_array_equal(session.sim.state.x.numpy(), before)
    np.testing.assert_array_equal(session.sim.state.v.numpy(), velocity)
    assert (session.frame, session.sim.frame, session.grabber.particle, session.holder) == (frame, frame, 20, 1)
    session.advance()
    np.testing.assert_array_equal(session.positions()[20], before[20])
    move(session, (480.0, 310.0))
    change(session, iterations=4)
    session.advance()
    np.testing.assert_allclose(place_of(session, 20), (480.0, 310.0), atol=1e-3)  # where it was to go it still goes
    change(session, iterations=3)
    status = session.status()
    assert status["settings"] | {"damping": 0, "stiffness": 0} == {
        **{"method": "gauss-seidel", "iterations": 3, "integrator": "pbd", "substeps": 11},
        **{"damping": 0, "stiffness": 0, "gravity": [0.0, 0.0, 0.0]},
    }
    assert f"launches a frame {11 * len(session.sim.passes) + 1}\n" in status["cost"]


@pytest.mark.parametrize(
    ("scene", "changes", "message"),
    [
        ("collision", {"integrator": "midpoint"}, "does not model contacts"),
        ("rope", {"integrator": "bdf2"}, "does not model damping"),
        ("rope", {"method": "direct", "stiffness": 0.5}, "stiffness below 1"),
        ("oscillator", {"stiffness": 0.5}, "one of the two"),
        ("collision", {"method": "direct"}, "direct"),
        ("rope", {"method": "newton"}, "unknown method"),
        ("rope", {"integrator": "euler"}, "unknown integrator"),
        ("rope", {"substeps": 400, "iterations": 400}, "too much for a live view"),
    ],
)
def test_a_change_that_makes_no_sense_changes_nothing(scene, changes, message):
    session = open_scene(scene)
    session.advance()
    sim, settings, events = session.sim, session.settings, session.recording.events.copy()
    with pytest.raises(pbd.InputError, match=message):
        change(session, **changes)
    assert session.sim is sim
    assert (session.settings, session.recording.events) == (settings, events)
    assert session.advance()


def test_another_method_keeps_the_iterations_but_for_direct():
    scene = pbd.load_scene("point")
    settings = Settings.of(scene)
    assert settings.changed(scene, method="gauss-seidel").method == pbd.GaussSeidel(iterations=4)
    assert settings.changed(scene, method="direct").method == pbd.Direct()
    assert settings.changed(scene, method="direct").changed(scene, method="jacobi").method == scene.method


def test_a_simulation_that_diverges_says_why_and_can_be_reset(tmp_path):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1, 0, 0)], velocity=[(1e38, 0, 0), (0, 0, 0)])
    session = Session(pbd.Scene(builder, name="far"), "far.py")
    for _ in range(600):
        session.advance()
    assert "particle 0 has left the finite numbers" in session.failure
    assert np.isfinite(session.positions()).all()
    assert session.frame + 1 == session.recording.frames < 600
    assert session.status()["failure"] == session.failure
    json.dumps(session.status(), allow_nan=False)
    session.do(1, say.Move(CAMERA, (1.0, 1.0)))
    for message in (say.Step(), say.Click(CAMERA, (400.0, 300.0))):
        with pytest.raises(pbd.InputError, match="reset it first"):
            session.do(1, message)
    assert not session.advance()
    session.do(1, say.Reset())
    assert session.failure is None
    assert session.advance()


def test_a_change_after_a_failure_starts_over():
    session = open_scene("rope", device=None)
    session.advance()
    session.sim.state.x.fill_(session.sim.vec3(np.nan, 0.0, 0.0))
    assert not session.advance()
    change(session, substeps=60)
    assert (session.failure, session.frame, session.sim.substeps) == (None, 0, 60)
    assert session.advance()


def test_unknown_scenes_are_refused():
    session = open_scene("rope")
    for name in ("roep", "/etc/passwd", "x.py", ""):
        with pytest.raises(pbd.InputError, match="unknown scene"):
            session.do(1, say.Load(name))
    assert session.generation == 1


@pytest.mark.parametrize("name", pbd.scene_names())
def test_every_scene_is_described(name):
    described = json.loads(json.dumps(open_scene(name).description(), allow_nan=False))
    model = pbd.load_scene(name).builder.finalize()
    assert len(described["radius"]) == model.particle_count
    assert min(described["radius"]) > 0.0
    assert described["links"] == model.distance.edge.tolist()
    assert described["axis"] == 2, "all scenes of the project lie in a plane and open face-on"
    assert described["ground"] < described["low"][1], "the grid is below the motion"
    if name == "collision":
        corners = np.array(described["planes"])
        assert corners.shape == (4, 4, 3)
        np.testing.assert_allclose(corners.min(axis=(0, 1))[:2], (0, 0), atol=1e-9)
        np.testing.assert_allclose(corners.max(axis=(0, 1))[:2], (2.0, 1.4), atol=1e-9)
    if name == "rope":
        np.testing.assert_allclose(described["low"][:2], (-1, -1), atol=0.02)  # where it can swing
        assert described["fixed"] == [0]


def test_a_scene_in_space_and_its_colliders():
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (0.5, 0, 0.3), (1, 0.2, 0)], radius=0.0)
    builder.add_plane((0, -2, 0), (0, 1, 0))
    builder.add_sphere((0.5, -1, 0), 0.25)
    described = Session(pbd.Scene(builder, name="mine"), "mine.py").description()
    assert described["axis"] is None
    assert described["spheres"] == [[0.5, -1.0, 0.0, 0.25]]
    assert np.allclose(np.array(described["planes"])[..., 1], -2.0)
    assert described["ground"] <= -2.0
    assert "mine" in described["scenes"]


# Takes


def take_of(scene="worm"):
    session = open_scene(scene)
    click(session, 0)
    move(session, (400.0, 310.0))
    session.advance()
    change(session, substeps=3)
    session.advance()
    return session.recording


def test_a_take_comes_back_as_it_was(tmp_path):
    recording = take_of()
    recording.save(tmp_path / "drags.json")
    assert Recording.load(tmp_path / "drags.json") == recording
    assert [p.name for p in tmp_path.iterdir()] == ["drags.json"]


def test_a_take_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    path = tmp_path / "drags.json"
    recording = take_of()
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
        (lambda d: d.update(fps=0), "fps must be"),
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
        (lambda d: d.update(model=3), "model must be a table"),
    ],
)
def test_a_spoiled_take_is_refused(spoil, message, tmp_path):
    path = tmp_path / "drags.json"
    take_of().save(path)
    data = json.loads(path.read_text())
    spoil(data)
    path.write_text(json.dumps(data))
    with pytest.raises(pbd.InputError, match=message):
        Recording.load(path)


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "[" * 100_000, "\x00"])
def test_what_is_no_take_is_refused(text, tmp_path):
    path = tmp_path / "drags.json"
    path.write_text(text)
    with pytest.raises(pbd.InputError, match="is no recording of drags"):
        Recording.load(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"integrator": "midpoint", "damping": 0.5}, "event 0: integrator 'midpoint' does not model damping"),
        ({"integrator": "zzz"}, "unknown integrator 'zzz'"),
        ({"integrator": []}, "unknown integrator"),
        ({"substeps": -1}, "substeps must be at least 1"),
        ({"stiffness": 5}, "stiffness must be"),
        ({"method": {"name": []}}, "unknown method"),
    ],
)
def test_settings_that_make_no_sense_are_refused_before_the_first_frame(changes, message, tmp_path):
    session = open_scene("rope")
    change(session, substeps=7)
    session.save(tmp_path / "t.json")
    text = json.loads((tmp_path / "t.json").read_text())
    text["events"][0][2].update(changes)
    (tmp_path / "t.json").write_text(json.dumps(text))
    scene = pbd.load_scene("rope")
    with pytest.raises(pbd.InputError, match=re.escape(message)):
        run(scene, tmp_path / "x.usda", recording=Recording.load(tmp_path / "t.json"))
    assert [path.name for path in tmp_path.iterdir()] == ["t.json"]


def test_a_take_of_another_scene_is_refused():
    recording = take_of()
    with pytest.raises(pbd.InputError, match="the drags are of scene worm, not of rope"):
        recording.load_scene("rope")
    scene = pbd.load_scene("worm")
    other = scene.changed(builder=pbd.load_scene("rope").builder)
    with pytest.raises(pbd.InputError, match="not what it was"):
        recording.replay(other, other.builder.finalize())
    recording.events.append((9, "select", 99))
    with pytest.raises(pbd.InputError, match="names particle 99"):
        recording.replay(scene, scene.builder.finalize())


def test_a_take_knows_its_model_again_in_spite_of_rounding():
    scene = pbd.load_scene("worm")
    model = scene.builder.finalize()
    take_of().replay(scene, dataclasses.replace(model, x=model.x * (1.0 + 1e-12)))
    with pytest.raises(pbd.InputError, match="not what it was"):
        take_of().replay(scene, dataclasses.replace(model, x=model.x * (1.0 + 1e-3)))


def test_replays_go_through_the_hand(monkeypatch):
    recording = take_of()
    gestures = []
    select = Grabber.select
    monkeypatch.setattr(Grabber, "select", lambda self, p: (gestures.append(p), select(self, p)))
    scene = pbd.load_scene("worm")
    replay = recording.replay(scene, scene.builder.finalize())
    replay.advance(replay.begin())
    assert gestures == [0]


# Pace


def test_frames_are_due_at_the_scenes_rate():
    pace = Pace(50.0, 10.0)
    for k in range(200):
        now = 10.0 + 0.02 * k
        assert now >= pace.due - 1e-9
        pace.made(now)
        assert pace.due == pytest.approx(now + 0.02)
    assert pace.speed(14.0) == pytest.approx(1.0, abs=0.02)
    assert pace.keeps_up(14.0)


def test_a_slow_simulation_says_so_and_does_not_spiral():
    pace = Pace(60.0, 0.0)
    now = 0.0
    for _ in range(100):
        now += 0.05  # a frame takes three times as long as it should
        pace.made(now)
        assert now - pace.due <= SLACK + 1e-9, "what was missed is dropped"
    assert pace.speed(now) == pytest.approx(1 / 3, abs=0.02)
    assert not pace.keeps_up(now)
    for _ in range(200):
        now += 1 / 60
        pace.made(now)
    assert pace.keeps_up(now), "soon after it is fast again"


def test_a_single_late_frame_is_caught_up_with():
    pace = Pace(60.0, 0.0)
    pace.made(0.06)
    assert pace.due == pytest.approx(1 / 60)
    assert pace.speed(0.5) is None, "too early to say"
    assert pace.keeps_up(0.5)
