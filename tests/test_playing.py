"""From Python: running for a while, reading what is there now, seeing it."""

import os
import signal
import sys
import threading
import types
import urllib.request

import numpy as np
import pytest
from rich.console import Console

import pbd_warp as pbd
from pbd_warp import progress
from pbd_warp.grab.drawing import DrawnRope
from pbd_warp.player import motion as motion_module
from pbd_warp.view import messages as say
from pbd_warp.view.server import ViewServer


def falling(**settings):
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    return pbd.Simulation(builder, **settings)


@pytest.mark.parametrize("how", [{"seconds": 0.25}, {"frames": 15}])
def test_run_makes_the_frames_that_steps_make(how):
    sim, other = falling(), falling()
    motion = sim.run(**how)
    assert sim.frame == 15
    assert motion.positions.shape == (16, 3, 3)
    for frame in range(16):
        np.testing.assert_array_equal(motion.positions[frame], other.positions)
        other.step()
    assert motion.fps == pytest.approx(60.0)
    assert "16 frames of 3 particles" in repr(motion)


@pytest.mark.parametrize("how", [{}, {"seconds": 1.0, "frames": 60}, {"seconds": -1.0}, {"frames": 1.5}])
def test_run_says_what_it_needs(how):
    with pytest.raises(pbd.InputError, match=r"seconds|frames"):
        falling().run(**how)


def test_positions_and_velocities_are_copies():
    sim = falling()
    before, still = sim.positions, sim.velocities
    sim.run(frames=3)
    np.testing.assert_array_equal(before, [(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    np.testing.assert_array_equal(still, np.zeros((3, 3)))
    assert sim.positions[2, 1] < 0.0
    assert sim.velocities[2, 1] < 0.0
    sim.positions[2] = 100.0
    assert sim.positions[2, 0] < 3.0


def test_without_a_terminal_progress_is_a_line_every_ten_seconds(capsys):
    now = iter([0.0, 4.0, 10.0, 12.0, 21.0])
    advance = progress._lines("rope", lambda: next(now))
    for done in (10, 25, 30, 50):
        advance(done, 100)
    assert capsys.readouterr().err.splitlines() == [
        "rope: 25 of 100 after 10 s, some 30 s to go",
        "rope: 50 of 100 after 21 s, some 21 s to go",
    ]


def test_progress_says_what_is_being_done(capsys, monkeypatch):
    """Without a terminal in its line, on a terminal beside its bar."""
    now = iter([0.0, 10.0, 20.0])
    advance = progress._lines("room", lambda: next(now))
    advance(0, None, "reading")
    advance(5, 10, "solving")
    assert capsys.readouterr().err.splitlines() == [
        "room reading: 0 after 10 s",
        "room solving: 5 of 10 after 20 s, some 20 s to go",
    ]
    monkeypatch.setattr(progress, "Console", lambda stderr: Console(stderr=stderr, force_terminal=True, width=100))
    for doing in ("reading", "solving", "writing"):
        with progress.progress_bar("room") as advance:
            advance(3, 10, doing)
        shown = capsys.readouterr().err
        assert f"room {doing}" in shown
        assert "3/10" in shown


def test_run_shows_progress_where_asked(capsys, monkeypatch):
    monkeypatch.setattr(progress, "LINE_EVERY", 0.0)
    falling().run(frames=2, progress=True)
    assert capsys.readouterr().err.startswith("frames: 1 of 2 after 0 s")
    falling().run(frames=2)
    assert capsys.readouterr().err == ""


def test_a_simulation_shows_what_comes_next_and_stays_where_it_is(monkeypatch):
    served = []
    monkeypatch.setattr(motion_module, "serve", lambda text, title: served.append(text))
    sim = falling()
    sim.run(frames=4)
    sim.show(seconds=0.5)
    assert sim.frame == 4
    assert '"frames": 31,' in served[0]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("shown", [lambda sim: sim.show(), pbd.show], ids=["sim.show", "pbd.show"])
def test_a_simulation_is_opened_live_as_it_is_now(shown, dtype, monkeypatch, capsys):
    """The page is there, the view's first frame is the simulation's present one, and Ctrl-C ends it."""
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
    builder.add_point(0, (0, 0, 0))
    sim = pbd.Simulation(builder.finalize(dtype=dtype), method="direct", substeps=3)
    sim.run(frames=4)
    before = sim.positions, sim.velocities
    sessions, pages = [], []

    class Watched(ViewServer):
        def __init__(self, session):
            super().__init__(session)
            sessions.append(session)

        async def start(self):
            await super().start()
            await self.begun

    def look(url):
        def fetch():
            with urllib.request.urlopen(url, timeout=20) as answer:
                pages.append(answer.read())
            os.kill(os.getpid(), signal.SIGINT)  # Ctrl-C

        threading.Thread(target=fetch).start()

    monkeypatch.setattr(sys.modules["pbd_warp.show"], "ViewServer", Watched)
    monkeypatch.setattr("webbrowser.open", look)
    shown(sim)
    assert "simulation is live at http://127.0.0.1:" in capsys.readouterr().out
    assert b"<title>pbd-warp</title>" in pages[0]
    (session,) = sessions
    assert (session.sim.model.dtype, session.settings.substeps, session.settings.method.name) == (dtype, 3, "direct")
    np.testing.assert_array_equal(session.frames.at(0).x, before[0])
    np.testing.assert_array_equal(session.frames.at(0).v, before[1])
    np.testing.assert_array_equal(sim.positions, before[0])
    assert sim.frame == 4
    with pytest.raises(pbd.InputError, match="nothing can be added to a simulation that is shown"):
        session.do(1, say.Rope(DrawnRope(((0, 1, 0), (1, 1, 0)), (0,))))


def test_in_jupyter_a_simulation_and_a_scene_are_players_in_the_page(monkeypatch):
    shown = []
    kernel = types.SimpleNamespace(get_ipython=lambda: types.SimpleNamespace(kernel=1))
    monkeypatch.setitem(__import__("sys").modules, "IPython", kernel)
    display = types.SimpleNamespace(display=shown.append)
    monkeypatch.setitem(__import__("sys").modules, "IPython.display", display)
    scene = pbd.load_scene("worm").changed(frames=8)
    pbd.show(scene)
    (motion,) = shown
    assert motion.frame_count == 8
    text = motion._repr_html_()
    assert text.startswith('<iframe srcdoc="&lt;!doctype html&gt;')
    assert text.count('"') == 6, "the page does not end its own attribute"
    assert falling()._repr_html_().startswith("<iframe")


def test_show_plays_a_file_and_refuses_what_it_cannot(monkeypatch, tmp_path):
    served = []
    monkeypatch.setattr(motion_module, "serve", lambda text, title: served.append(title))
    sim = falling()
    with pbd.UsdWriter(tmp_path / "r.usda", sim.model) as writer:
        writer.write(sim.state)
    pbd.show(tmp_path / "r.usda")
    pbd.show(sim.run(frames=2))
    assert served == ["r.usda", "frames from 0"]
    with pytest.raises(pbd.InputError, match="show takes"):
        pbd.show(3)


@pytest.mark.parametrize("method", ["direct", pbd.Direct, pbd.Direct()])
def test_a_method_by_name_by_class_or_made(method):
    assert falling(method=method).settings.method == pbd.Direct()


def test_what_is_printed_says_what_it_is():
    sim = falling(method="direct")
    scene = pbd.load_scene("rope")
    for thing, words in (
        (sim.model, ["3 particles", "2 distances", "float32"]),
        (sim, ["3 particles", "frame 0", "Direct("]),
        (scene, ["rope", "21 particles", "600 frames", "GaussSeidel("]),
    ):
        assert all(word in repr(thing) for word in words)
        assert len(repr(thing)) < 250


def test_the_same_point_twice_in_a_row_of_a_rope_is_refused():
    with pytest.raises(pbd.InputError, match=r"points 1 and 2 of a rope are the same: leave one of them out"):
        pbd.ModelBuilder().add_rope([(0, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0, 0)])
    pbd.ModelBuilder().add_rope([(0, 0, 0), (1, 0, 0), (0, 0, 0)])  # there and back is a rope
