"""The page around the picture, in headless Chromium: what it says, changes, plots, saves and opens."""

import threading

import numpy as np
import pytest
from browser import served
from pages import session_of
from pxr import Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.grab.recording import Recording
from pbd_warp.step import loading
from pbd_warp.view.session import Session


def test_keys_and_buttons_pause_step_reset_and_let_go(open_page):
    session = session_of("point")
    with served(session) as server:
        page = open_page(server)
        keyboard = page.page.keyboard
        page.click_on(10)
        keyboard.press("Escape")
        page.until("pbd.held === -1")
        page.pause()
        frame = page.get("pbd.frame")
        page.page.wait_for_timeout(150)
        assert page.get("pbd.frame") == frame == session.frame
        keyboard.press("s")
        page.until(f"pbd.frame === {frame + 1}")
        page.page.get_by_role("button", name="Step").click()
        page.until(f"pbd.frame === {frame + 2}")
        page.page.get_by_role("button", name="Go on").click()
        page.frames(5)
        page.page.get_by_role("button", name="Pause").click()
        page.until("pbd.paused")
        keyboard.press("r")
        page.until("pbd.frame === 0")
        keyboard.press("Space")
        page.frames(5)


def test_what_is_changed_on_the_panel_takes_effect(open_page):
    session = session_of("rope")
    with served(session) as server:
        page = open_page(server)
        panel = page.page
        panel.locator("#gravity").fill("0")
        panel.locator("#substeps").fill("12")
        panel.locator("#substeps").press("Enter")
        panel.locator("#method").select_option("jacobi")
        panel.locator("#iterations").fill("6")
        panel.locator("#iterations").press("Tab")
        panel.locator("#damping").fill("0")
        panel.locator("#stiffness").fill("0.5")
        panel.locator("#grab_acceleration").select_option("strong")
        expected = session.scene.settings.changed(
            **{"method": pbd.Jacobi(iterations=6), "substeps": 12, "damping": 0.0, "stiffness": 0.5},
            **{"gravity": (0.0, 0.0, 0.0), "grab_acceleration": 400.0, "on_failure": "continue"},
        )
        page.wait_for(lambda: session.settings == expected)
        page.until("/launches a frame/.test(document.querySelector('#cost').textContent)")
        assert "launches" not in panel.locator("body").inner_text(), "the cost sheet is folded"
        panel.locator("#integrator").select_option("midpoint")
        panel.get_by_text("integrator 'midpoint' does not model stiffness below 1").wait_for()
        assert session.settings == expected
        page.until("document.querySelector('#integrator').value === 'pbd'")
        panel.locator("#said").get_by_role("button", name="Stiffness 1").click()
        page.wait_for(lambda: session.settings.integrator == "midpoint" and session.settings.stiffness == 1.0)
        page.frames(5)
        for figure in ("frame", "ms", "stretch", "residual", "energy"):
            assert any(character.isdigit() for character in panel.locator(f"#{figure}").text_content())


def test_a_scene_is_opened_with_its_parameters(open_page):
    session = session_of("rope")
    with served(session) as server:
        page = open_page(server)
        page.page.locator("#scene").click()
        dialog = page.page.get_by_role("dialog", name="Open a scene")
        dialog.get_by_text("A chain of rigid links falls").click()
        assert "how many the metre is made of" in dialog.inner_text()
        dialog.get_by_role("textbox", name="links").fill("four")
        dialog.get_by_role("button", name="Open").click()
        page.page.locator("#said").get_by_text("links of scene chain must be like 9, not 'four'").wait_for()
        assert page.page.locator("#scene").inner_text().split() == ["rope"], "name and picture agree"
        page.page.locator("#scene").click()
        dialog.get_by_text("A chain of rigid links falls").click()
        dialog.get_by_role("textbox", name="links").fill("5")
        dialog.get_by_role("button", name="Open").click()
        page.until("pbd.count === 6 && pbd.scene === 'chain'")
        assert page.page.locator("#scene").inner_text().split() == ["chain", "links", "5"]
        assert page.page.title() == "chain · pbd-warp"
        page.page.locator("#defaults").click()
        page.wait_for(lambda: session.generation == 3)
        assert session.recording.parameters == {"links": "5"}


def test_a_link_opens_scene_and_settings_once(open_page, chromium):
    session = session_of("rope")
    with served(session) as server:
        page = open_page(server, permissions=["clipboard-read", "clipboard-write"])
        page.page.locator("#substeps").fill("9")
        page.page.locator("#substeps").press("Enter")
        page.wait_for(lambda: session.settings.substeps == 9)
        page.until("document.querySelector('#substeps').value === '9'")
        page.page.get_by_role("button", name="Copy link").click()
        page.page.get_by_text("The link is copied.").wait_for()
        link = page.get("navigator.clipboard.readText()")
        assert link.startswith(server.url)
        page.page.locator("#substeps").fill("3")
        page.page.locator("#substeps").press("Enter")
        page.wait_for(lambda: session.settings.substeps == 3)
        page.page.goto("about:blank")
        page.page.goto(link)
        page.wait_for(lambda: session.settings.substeps == 9)
        page.until("pbd.ready && pbd.frame > 5")
        assert page.get("location.hash") == ""
        generation = session.generation
        page.page.reload()
        page.until("pbd.ready && pbd.frame > 5")
        assert session.generation == generation, "a reload shows what is there"


def test_one_goes_back_and_on_from_there(open_page):
    session = session_of("rope")
    with served(session) as server:
        page = open_page(server)
        page.until("pbd.frame > 60")
        page.page.locator("#rewind").fill("20")
        page.until("pbd.shown === 20 && pbd.paused")
        back = page.page.locator("label", has_text="Rewind").locator("output")
        assert back.inner_text().endswith(" s")
        np.testing.assert_array_equal(page.positions().astype(np.float32), session.frames.at(20)[0])
        page.page.locator("#rewind").fill("40")
        page.until("pbd.frame === 40")
        page.go_on()
        page.until("pbd.frame > 45")
        assert session.recording.events[0][0] == 40


def test_what_is_recorded_is_saved(open_page, tmp_path):
    session = session_of("rope")
    with served(session) as server:
        page = open_page(server)
        page.page.get_by_role("button", name="Record").click()
        page.page.get_by_role("button", name="Stop").wait_for()
        page.frames(30)
        page.page.get_by_role("button", name="Stop").click()
        page.page.get_by_role("button", name="Record").wait_for()
        count = len(session.clip.states)
        assert count > 20
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save USD").click()
        assert download.value.suggested_filename == "rope.usdc"
        download.value.save_as(tmp_path / "rope.usdc")
        stage = Usd.Stage.Open(str(tmp_path / "rope.usdc"))
        assert len(UsdGeom.Points.Get(stage, "/World/Particles").GetPointsAttr().GetTimeSamples()) == count
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save drags").click()
        download.value.save_as(tmp_path / "drags.json")
        assert Recording.load(tmp_path / "drags.json").scene == "rope"
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save picture").click()
        download.value.save_as(tmp_path / "rope.png")
        assert download.value.suggested_filename.startswith("rope-")
        assert len({tuple(pixel) for pixel in pixels(tmp_path / "rope.png").reshape(-1, 3)}) > 20, "it shows something"


def pixels(path):
    import matplotlib.image

    return matplotlib.image.imread(path)[..., :3]


def test_a_rope_is_drawn_by_hand(open_page):
    session = session_of("rope")
    with served(session) as server:
        page = open_page(server)
        page.page.get_by_role("button", name="Draw a rope").click()
        places = [(120, 100), (250, 140), (380, 100)]
        add = page.page.get_by_role("button", name="Add the rope")
        assert add.is_disabled()
        for place in places:
            page.page.mouse.click(*place)
        page.page.mouse.click(500, 300)
        page.page.get_by_role("button", name="Undo").click()
        page.page.mouse.click(*places[0])
        page.page.mouse.click(*places[2])
        assert page.page.locator("#drawn circle.pin").count() == 2
        assert page.get("pbd.held") == -1, "no particle is taken meanwhile"
        add.click()
        page.wait_for(lambda: len(session.recording.ropes) == 1)
        (rope,) = session.recording.ropes
        assert (len(rope.points), rope.pinned) == (3, (0, 2))
        page.until(f"pbd.count === {session.model.particle_count} && pbd.frame > 1")
        np.testing.assert_allclose([page.place(21), page.place(51)], [places[0], places[2]], atol=1.0)
        assert np.allclose(np.array(rope.points)[:, 2], 0.0, atol=1e-9), "in the picture's plane"


def test_fit_and_what_walks_out_is_framed(open_page):
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (0.5, 0, 0), (1, 0, 0)], pinned=(), radius=0.05)
    session = Session(pbd.Scene(builder, substeps=4, name="falling"), "falling.py")
    with served(session) as server:
        page = open_page(server)
        page.until("pbd.frame > 90")  # it has fallen 11 m
        page.page.wait_for_timeout(700)
        y = page.place(1)[1]
        assert 0 < y < 560, "it is followed"
        page.pause()
        page.page.mouse.wheel(0, -600)
        page.page.mouse.move(200, 200)
        page.page.mouse.wheel(0, -900)
        far = page.get("pbd.camera.distance")
        page.page.keyboard.press("f")
        page.until(f"pbd.camera.distance !== {far}")
        for particle in range(3):
            x, y = page.place(particle)
            assert 0 < x < 612
            assert 0 < y < 560
        page.page.get_by_role("button", name="Fit").click()


def test_a_question_mark_shows_what_one_can_do(open_page):
    with served(session_of("rope")) as server:
        page = open_page(server)
        page.page.keyboard.press("?")
        page.page.get_by_role("dialog", name="What one can do").get_by_text("press on it and drag").first.wait_for()
        page.page.keyboard.press("r")
        page.page.keyboard.press("Escape")
        page.until("!document.querySelector('dialog[open]')")
        page.frames(3)


def test_what_is_compiled_is_said_while_one_waits(open_page, monkeypatch):
    session, go_on = session_of("rope"), threading.Event()
    begin = session.begin

    def slow():
        for tell in loading.listeners:
            tell("distance, float32 (1 of 3)")
        assert go_on.wait(20)
        begin()

    monkeypatch.setattr(session, "begin", slow)
    with served(session) as server:
        page = open_page(server, ready=False)
        page.page.get_by_text("Opening rope").wait_for()
        page.page.get_by_text("compiling distance, float32 (1 of 3)").wait_for()
        go_on.set()
        page.until("pbd.ready && pbd.frame > 3")
        assert not page.page.locator("#busy").is_visible()


def test_a_simulation_that_diverges_is_shown_with_remedies_and_reset(open_page):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_rope([(0, 0, 0), (1, 0, 0)], radius=0.05)
    session = Session(pbd.Scene(builder, name="far"), "far.py")
    with served(session) as server:
        page = open_page(server)
        session.sim.state.x.fill_(np.nan)
        alert = page.page.get_by_role("alert")
        alert.get_by_text("has left the finite numbers").wait_for()
        alert.get_by_role("button", name="Reset").click()
        page.frames(5)
        assert not alert.first.is_visible()
        session.failure = "frame 3 failed: use Direct, or more substeps"
        alert.get_by_role("button", name="2 substeps").click()
        page.wait_for(lambda: session.settings.substeps == 2 and session.failure is None)


def test_plots_show_what_was_chosen(open_page):
    """Read back from the pixels: a line in the colour of what is chosen, none without."""
    session = session_of("chain")
    with served(session) as server:
        page = open_page(server, viewport={"width": 1000, "height": 1100})
        page.until("pbd.frame > 60")
        count = """(variable) => {
            const canvas = document.querySelector("#plot");
            const hex = getComputedStyle(canvas).getPropertyValue(variable).match(/[0-9a-f]{2}/g);
            const wanted = hex.map((digits) => parseInt(digits, 16));
            const data = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
            let found = 0;
            for (let k = 0; k < data.length; k += 4) {
              found += wanted.every((value, j) => Math.abs(value - data[k + j]) < 12);
            }
            return found;
        }"""

        def drawn(number):
            return page.page.evaluate(count, f"--plot-{number}")

        labels = page.page.locator("#plots label").all_inner_texts()
        assert labels == ["energy", "kinetic", "potential", "stretch", "residual", "iterations", "time a frame"]
        assert drawn(0) > 20
        assert drawn(1) > 20
        assert drawn(5) == 0
        page.page.locator("#plots").get_by_label("iterations").check()
        page.page.wait_for_timeout(300)
        assert drawn(5) > 20
        assert drawn(0) == 0, "of another unit"
        page.page.locator("#plots").get_by_label("iterations").uncheck()
        page.page.wait_for_timeout(300)
        assert drawn(5) == 0
        page.page.locator("#method").select_option("gauss-seidel")
        page.until("!document.querySelector('#plots').textContent.includes('iterations')")


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(0, 1, [0, 0.5, 1]), (-3.2, 7.1, [-5, 0, 5, 10]), (0.0021, 0.0029, [0.002, 0.0025, 0.003]), (5, 5, None)],
)
def test_axes_have_round_ticks_around_the_values(open_page, low, high, expected):
    with served(session_of("worm")) as server:
        page = open_page(server)
        axis = page.page.evaluate(f"import('./plot.js').then(({{ axis }}) => axis({low}, {high}))")
        assert axis["low"] <= low <= high <= axis["high"]
        if expected:
            np.testing.assert_allclose(axis["ticks"], expected, atol=1e-12)


def test_colour_by_stretch(open_page):
    with served(session_of("rope")) as server:
        page = open_page(server)
        page.pause()
        plain = page.page.locator("#picture").screenshot()
        page.page.get_by_label("Colour").select_option("stretch")
        page.until("!document.querySelector('#legend').hidden")
        assert page.page.locator("#legend").inner_text().count("%") == 2
        assert page.page.locator("#picture").screenshot() != plain


def test_colour_by_tension_where_the_method_knows_it(open_page):
    """What is shown is what `tension` says of the frame that is shown, also of one that was gone back to."""
    session = session_of("rope")
    with served(session) as server:
        page = open_page(server)
        panel = page.page
        panel.locator("#method").select_option("jacobi")
        panel.wait_for_function("() => document.querySelector('#colour [value=tension]').disabled")
        panel.locator("#method").select_option("direct")
        panel.wait_for_function("() => !document.querySelector('#colour [value=tension]').disabled")
        page.frames(20)
        page.pause()
        page.until("pbd.shown === pbd.frame && pbd.tension.length > 0")
        np.testing.assert_allclose(page.get("pbd.tension"), session.sim.tension, rtol=1e-6)
        plain = panel.locator("#picture").screenshot()
        panel.get_by_label("Colour").select_option("tension")
        page.until("!document.querySelector('#legend').hidden")
        assert panel.locator("#legend").inner_text().split()[1::2] == ["N", "N"]
        assert panel.locator("#picture").screenshot() != plain
        frame = page.get("pbd.frame") - 5
        panel.locator("#rewind").fill(str(frame))
        page.until(f"pbd.shown === {frame}")
        np.testing.assert_array_equal(page.get("pbd.tension"), session.frames.at(frame).tension)
        assert not np.array_equal(session.frames.at(frame).tension, session.sim.tension.astype(np.float32))


def test_the_page_lives_with_its_security_policy_and_says_when_the_server_has_ended(open_page):
    """As a user's browser has it, without the tests' exemption."""
    with served(session_of("point")) as server:
        page = open_page(server, ready=False, bypass_csp=False)
        page.page.locator("#energy").get_by_text("J").wait_for()
        page.wait_for(lambda: page.get("pbd.frame") > 3)
        assert page.get("pbd.drawn") > 0
        with page.page.expect_download() as download:
            page.page.get_by_role("button", name="Save picture").click()
        assert download.value.suggested_filename.endswith(".png")
        assert page.errors == []
    page.page.get_by_text("pbd-warp view has ended. Start it again, and this page goes on.").wait_for()
    page.errors.clear()  # those of the connection that was refused
