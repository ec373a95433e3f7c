"""A running scene without any network: what pages can do to it."""

import json

import numpy as np
import pytest
from sessions import Film, change, move, off, open_scene, position, select

import pbd_warp as pbd
from pbd_warp.view import messages as say
from pbd_warp.view.changes import GRAB_ACCELERATION, changed
from pbd_warp.view.report import status
from pbd_warp.view.session import HEADER, Session


def test_one_move_a_frame_is_recorded():
    session = open_scene("worm")
    select(session, 0)
    for k in range(5):
        move(session, (0.01 * k, 0.0, 0.0))
    session.advance()
    move(session, (0.1, 0.0, 0.0))
    session.advance()
    session.advance()
    assert [(frame, what) for frame, what, _ in session.recording.events] == [(0, "select"), (0, "move"), (1, "move")]


def test_only_one_page_drags_and_what_it_holds_is_free_when_it_goes():
    session = open_scene("worm")
    select(session, 3, who=1)
    assert (session.holder, session.grabber.particle) == (1, 3)
    with pytest.raises(pbd.InputError, match="page 1 is dragging"):
        select(session, 5, who=2)
    before = session.recording.events.copy()
    move(session, (0.3, 0.0, 0.0), who=2)
    session.do(2, say.Release())
    session.leave(2)
    assert (session.holder, session.grabber.particle, session.recording.events) == (1, 3, before)
    session.leave(1)
    assert (session.holder, session.grabber.particle) == (None, None)
    select(session, 5, who=2)
    assert (session.holder, session.grabber.particle) == (2, 5)
    session.do(2, say.Release())
    assert (session.holder, session.grabber.particle) == (None, None)


def test_a_particle_is_held_where_the_page_has_seen_it():
    """The page shows frame 20, the simulation is at frame 26 when the click arrives."""
    session = open_scene("rope")
    Film(session).roll(20)
    seen = position(session, 20)
    Film(session).roll(6)
    assert np.linalg.norm(position(session, 20) - seen) > 0.1
    session.do(1, say.Select(20, 20, session.generation))
    np.testing.assert_array_equal(session.sim.held_target, seen)
    Film(session).roll(90)
    assert np.linalg.norm(position(session, 20) - seen) < 1e-3, "it comes back to where it was clicked"


def test_what_was_clicked_in_a_picture_of_before_a_reset_is_refused():
    session = open_scene("rope")
    Film(session).roll(20)
    old = say.Select(20, session.frame, session.generation)
    session.do(1, say.Reset())
    with pytest.raises(pbd.InputError, match="the scene has started anew"):
        session.do(1, old)
    session.do(1, say.Open("worm", {}, {}))
    with pytest.raises(pbd.InputError, match="the scene has started anew"):
        session.do(1, say.Select(20, 0, session.generation - 1))
    with pytest.raises(pbd.InputError, match="grab"):
        session.do(1, say.Select(99, 0, session.generation))
    assert session.holder is None


def test_the_packet_says_who_holds_whom_and_pulls_it_where():
    session = open_scene("worm")
    assert HEADER.unpack(session.packet()[: HEADER.size]) == (1, 0, -1, 0, 0.0, 0.0, 0.0)
    select(session, 3, who=7)
    move(session, (0.25, 0.5, 0.0), who=7)
    session.advance()
    packet = session.packet()
    assert HEADER.unpack(packet[: HEADER.size]) == (1, 1, 3, 7, 0.25, 0.5, 0.0)
    x = np.frombuffer(packet[HEADER.size :], np.float32).reshape(-1, 3)
    np.testing.assert_array_equal(x, session.sim.state.x.numpy())
    session.do(1, say.Open("rope", {}, {}))
    assert HEADER.unpack(session.packet()[: HEADER.size]) == (2, 0, -1, 0, 0.0, 0.0, 0.0)


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


@pytest.mark.parametrize("acceleration", [GRAB_ACCELERATION, None])
def test_a_change_of_settings_goes_on_from_the_present_state(acceleration):
    session = open_scene("rope")
    change(session, grab_acceleration=acceleration)
    select(session, 20)
    start = position(session, 20)
    Film(session).roll(10, lambda k: move(session, off(start, -0.02 * k, 0)))
    before, velocity, frame = session.sim.state.x.numpy(), session.sim.state.v.numpy(), session.frame
    change(session, iterations=3, substeps=11, gravity=(0.0, 0.0, 0.0))
    assert (session.settings.method.iterations, session.sim.substeps) == (3, 11)
    np.testing.assert_array_equal(session.sim.state.x.numpy(), before)
    np.testing.assert_array_equal(session.sim.state.v.numpy(), velocity)
    assert (session.frame, session.sim.frame, session.grabber.particle, session.holder) == (frame, frame, 20, 1)
    session.advance()
    if acceleration is None:
        np.testing.assert_array_equal(session.positions()[20], before[20])
    move(session, off(start, -0.2, -0.3))
    change(session, iterations=4)
    Film(session).roll(1 if acceleration is None else 90)
    np.testing.assert_allclose(
        position(session, 20), off(start, -0.2, -0.3), atol=1e-3
    )  # where it was to go it still goes
    change(session, iterations=3)
    told = status(session)
    expected = {"method": "gauss-seidel", "iterations": 3, "integrator": "pbd", "substeps": 11}
    assert expected.items() <= told["settings"].items()
    assert told["settings"]["gravity"] == [0.0, 0.0, 0.0]
    assert told["settings"]["grab_acceleration"] == acceleration


def test_holding_goes_on_when_it_becomes_exact_and_back():
    session = open_scene("rope")
    select(session, 20)
    start = position(session, 20)
    move(session, off(start, 5.0, 0.0))  # further than the rope is long
    Film(session).roll(60)
    change(session, grab_acceleration=None)
    where = position(session, 20)
    Film(session).roll(3)
    np.testing.assert_array_equal(position(session, 20), where.astype(np.float32), "it does not jump to the target")
    assert session.sim.held == 20
    change(session, grab_acceleration=50.0)
    np.testing.assert_allclose(session.sim.held_target, where, atol=1e-6)
    session.do(1, say.Release())
    Film(session).roll(20)
    assert position(session, 20)[1] < where[1] - 0.05, "it falls: it has its mass again"


@pytest.mark.parametrize(
    ("scene", "changes", "message"),
    [
        ("collision", {"integrator": "midpoint"}, "does not model contacts"),
        ("rope", {"integrator": "bdf2"}, "does not model damping"),
        ("rope", {"method": "direct", "stiffness": 0.5}, "stiffness below 1"),
        ("oscillator", {"stiffness": 0.5}, "one of the two"),
        ("rope", {"method": "newton"}, "unknown method"),
        ("rope", {"integrator": "euler"}, "unknown integrator"),
        ("rope", {"substeps": 400, "iterations": 400}, "too much for a live view"),
        ("rope", {"dtype": "float64", "integrator": "bdf2"}, "does not model damping"),
    ],
)
def test_a_change_that_makes_no_sense_changes_nothing(scene, changes, message):
    session = open_scene(scene)
    session.advance()
    sim, settings, events = session.sim, session.settings, session.recording.events.copy()
    with pytest.raises(pbd.InputError, match=message):
        change(session, **changes)
    assert session.sim is sim
    assert (session.settings, session.recording.events, session.dtype) == (settings, events, "float32")
    assert session.advance()


def test_another_method_keeps_the_iterations_but_for_direct():
    own = pbd.load_scene("point").settings
    assert changed(own, own, method="gauss-seidel").method == pbd.GaussSeidel(iterations=4)
    assert changed(own, own, method="direct").method == pbd.Direct()
    assert changed(changed(own, own, method="direct"), own, method="jacobi").method == own.method


def test_another_precision_starts_over():
    session = open_scene("rope")
    Film(session).roll(5)
    change(session, dtype="float64", substeps=9)
    assert (session.model.dtype, session.recording.dtype, session.frame) == ("float64", "float64", 0)
    assert session.settings.substeps == 9
    assert session.advance()
    assert session.positions().dtype == np.float32


def test_a_simulation_that_diverges_says_why_and_can_be_reset():
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1, 0, 0)], velocity=[(1e38, 0, 0), (0, 0, 0)])
    session = Session(pbd.Scene(builder, name="far"), "far.py")
    session.begin()
    for _ in range(600):
        session.advance()
    assert "particle 0 has left the finite numbers" in session.failure
    assert np.isfinite(session.positions()).all()
    assert session.frame + 1 == session.recording.frames < 600
    session.do(1, say.Move((1.0, 1.0, 0.0)))
    for message in (say.Step(), say.Select(0, session.frame, 1)):
        with pytest.raises(pbd.InputError, match="reset it first"):
            session.do(1, message)
    assert not session.advance()
    session.do(1, say.Reset())
    assert session.failure is None
    assert session.advance()


def test_after_a_failure_one_can_go_back_to_before_it():
    session = open_scene("rope")
    Film(session).roll(20)
    was = session.frames.at(15)[0].copy()
    session.sim.state.x.fill_(np.nan)
    assert not session.advance()
    session.do(1, say.Rewind(15))
    np.testing.assert_array_equal(session.positions(), was)
    session.do(1, say.Pause(False))
    assert session.failure is None
    assert session.advance()
    assert session.frame == 16


def test_a_change_after_a_failure_starts_over():
    session = open_scene("rope")
    session.advance()
    session.sim.state.x.fill_(np.nan)
    assert not session.advance()
    change(session, substeps=60)
    assert (session.failure, session.frame, session.sim.substeps) == (None, 0, 60)
    assert session.advance()


def test_unknown_scenes_are_refused():
    session = open_scene("rope")
    for name in ("roep", "/etc/passwd", "x.py", ""):
        with pytest.raises(pbd.InputError, match="unknown scene"):
            session.do(1, say.Open(name, {}, {}))
    with pytest.raises(pbd.InputError, match="no parameters"):
        session.do(1, say.Open("rope", {"links": "3"}, {}))
    assert session.generation == 1


def test_a_scene_is_opened_with_parameters_and_settings():
    session = open_scene("rope")
    session.do(1, say.Open("chain", {"links": "5"}, {"substeps": 7}))
    assert (session.scene.name, session.model.particle_count, session.settings.substeps) == ("chain", 6, 7)
    assert session.recording.parameters == {"links": "5"}
    with pytest.raises(pbd.InputError, match="links of scene chain must be like 9"):
        session.do(1, say.Open("chain", {"links": "five"}, {}))
    assert session.generation == 2
    session.do(1, say.Open("rope", {}, {}))
    assert session.settings == pbd.load_scene("rope").settings.changed(
        grab_acceleration=GRAB_ACCELERATION, on_failure="continue"
    )


# Back


def test_what_is_gone_back_to_is_shown_and_nothing_is_lost_until_it_goes_on():
    session = open_scene("rope")
    film = Film(session).roll(40)
    session.do(1, say.Rewind(10))
    assert (session.frame, session.paused, session.advance()) == (10, True, False)
    np.testing.assert_array_equal(session.positions(), film.frames[10])
    session.do(1, say.Rewind(30))
    np.testing.assert_array_equal(session.positions(), film.frames[30])
    session.do(1, say.Rewind(40))
    session.do(1, say.Pause(False))
    session.advance()
    assert session.frame == 41
    with pytest.raises(pbd.InputError, match="frame 42 is not kept: there are 0 to 41"):
        session.do(1, say.Rewind(42))


def test_one_can_go_back_ten_seconds_and_no_more():
    session = open_scene("oscillator")
    fps = session.scene.fps
    Film(session).roll(int(12 * fps))
    assert session.frames.first == session.frame - 10 * fps
    with pytest.raises(pbd.InputError, match="is not kept"):
        session.do(1, say.Rewind(session.frames.first - 1))


# What is kept


def test_frames_between_record_and_stop_are_kept(monkeypatch):
    session = open_scene("rope")
    film = Film(session).roll(10)
    session.do(1, say.Record(True))
    assert session.kept == 1
    film.roll(700)  # more than ten seconds
    assert status(session)["kept"] == 701
    session.do(1, say.Record(False))
    film.roll(5)
    session.do(1, say.Open("worm", {}, {}))
    clip = session.clip_now()
    assert (clip.name, clip.fps, len(clip.states)) == ("rope", 60.0, 701)
    np.testing.assert_array_equal([kept.x for kept in clip.states], film.frames[10:711])


def test_without_a_recording_the_last_ten_seconds_are_saved():
    session = open_scene("rope")
    film = Film(session).roll(20)
    np.testing.assert_array_equal([kept.x for kept in session.clip_now().states], film.frames)


def test_a_recording_that_has_no_more_room_ends_and_says_so(monkeypatch):
    session = open_scene("rope")
    monkeypatch.setattr("pbd_warp.view.history.ROOM", 20 * 2 * session.positions().nbytes)
    session.do(1, say.Record(True))
    Film(session).roll(30)
    assert session.kept is None
    assert session.notes == ["recording has ended: there is no room for more than 20 frames"]
    json.dumps(status(session), allow_nan=False)
