"""Light and dark, phones, touch, scenes in space: what is drawn is read back from the pixels."""

import os
import shutil
import signal
import subprocess
import time

import matplotlib.image
import numpy as np
import pytest
from browser import served
from pages import session_of

import pbd_warp as pbd
from pbd_warp.view.session import Session

PHONE = {"viewport": {"width": 390, "height": 780}, "has_touch": True, "is_mobile": True}
BACK = {"dark": (0.075, 0.092, 0.122), "light": (0.965, 0.97, 0.98)}


def shot_of(page, tmp_path):
    """Pixels of the whole page, [height, width, 3]."""
    page.page.screenshot(path=tmp_path / "p.png")
    return matplotlib.image.imread(tmp_path / "p.png")[..., :3]


def luminance(colour):
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


@pytest.mark.parametrize("scheme", ["dark", "light"])
def test_the_page_is_as_light_as_the_system_prefers(scheme, open_page, tmp_path):
    with served(session_of("point")) as server:
        page = open_page(server, color_scheme=scheme)
        page.pause()
        pixels = shot_of(page, tmp_path)
        assert np.abs(pixels[300, 5] - BACK[scheme]).max() < 0.02, "the background"
        fixed, free = (pixels[round(y), round(x)] for x, y in (page.place(0), page.place(5)))
        assert free[0] > 1.3 * free[2], "particles are warm"
        assert np.ptp(fixed) < 0.2, "a fixed one is grey"
        assert abs(luminance(free) - luminance(pixels[300, 5])) > 0.1
        assert (luminance(pixels[-3, -3]) > 0.5) == (scheme == "light"), "the panel"
        # What is read has the contrast that WCAG asks for.
        for selector in ("#frame", "dt", "#pace", "#scene", "button", "#hint", "label"):
            text, back = page.get(COLOURS.format(selector=selector))
            bright, dark = sorted((luminance(np.array(text)), luminance(np.array(back))), reverse=True)
            assert (bright + 0.05) / (dark + 0.05) >= 4.5, selector
        page.page.emulate_media(color_scheme="light" if scheme == "dark" else "dark")
        page.page.wait_for_timeout(300)
        other = BACK["light" if scheme == "dark" else "dark"]
        assert np.abs(shot_of(page, tmp_path)[300, 5] - other).max() < 0.02, "at once"


COLOURS = """(() => {{
    const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
    const element = document.querySelector("{selector}");
    let under = element;
    const opaque = (node) => (rgb(getComputedStyle(node).backgroundColor)[3] ?? 1) > 0.8;
    while (!opaque(under)) under = under.parentElement;
    const back = rgb(getComputedStyle(under).backgroundColor);
    return [rgb(getComputedStyle(element).color), back].map((colour) => colour.slice(0, 3).map((value) => value / 255));
}})()"""


def test_a_phone_has_its_hint_large_targets_figures_within_reach_and_a_panel_that_folds(open_page):
    with served(session_of("rope")) as server:
        page = open_page(server, **PHONE)
        body = page.page.locator("body")
        assert "Tap a particle" in body.inner_text()
        assert "Click a particle" not in body.inner_text()
        for figure in ("#frame", "#ms", "#stretch", "#residual", "#energy"):
            assert page.page.locator(figure).is_visible(), "also while it is folded"
        assert not page.page.locator("#method").is_visible()
        canvas = page.page.locator("#picture").bounding_box()
        assert canvas["height"] > 0.6 * 780, "the picture has most of it"
        page.page.locator("#fold").click()
        page.page.locator("#method").wait_for()
        small = page.get(
            """[...document.querySelectorAll("button, select, input, summary, [role=button]")]
            .filter((element) => element.checkVisibility())
            .map((element) => (element.matches("input[type=checkbox]") ? element.parentElement : element))
            .filter((element) => element.getBoundingClientRect().height < 43.5)
            .map((element) => element.outerHTML.slice(0, 80))"""
        )
        assert small == []
        assert page.get("document.documentElement.scrollWidth") == 390, "nothing sticks out"
        page.page.locator("#fold").click()
        assert not page.page.locator("#method").is_visible()


@pytest.mark.parametrize("options", [{}, PHONE])
def test_sentences_cover_nothing(options, open_page):
    with served(session_of("rope")) as server:
        page = open_page(server, **options)
        canvas = page.page.locator("#picture").bounding_box()
        for _ in range(3):
            page.get("window.pbd.tell('integrator bdf2 does not model damping: leave it out or use another one')")
        said = page.page.locator("#said").bounding_box()
        shown = page.page.locator("#picture").bounding_box()
        assert said["height"] > 50
        apart = said["x"] >= shown["x"] + shown["width"] - 1 or said["y"] >= shown["y"] + shown["height"] - 1
        assert apart, "not the picture"
        buttons = page.page.locator("nav").bounding_box()
        assert said["y"] >= buttons["y"] + buttons["height"] or said["y"] + said["height"] <= buttons["y"] + 1
        if not options:
            assert shown == canvas, "and it does not move"


def test_touch_taps_drags_and_zooms(open_page):
    with served(session_of("point")) as server:
        page = open_page(server, has_touch=True)
        touch = page.page.context.new_cdp_session(page.page)

        def finger(kind, *places):
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y} for x, y in places]})

        def drag(start, way, count=20):
            finger("touchStart", start)
            for k in range(1, count + 1):
                finger("touchMove", (start[0] + way[0] * k / count, start[1] + way[1] * k / count))
                page.page.wait_for_timeout(10)

        x, y = page.place(10)
        page.page.touchscreen.tap(x, y)
        page.until("pbd.held === 10 && pbd.holder === pbd.me")
        drag((x - 20, y + 10), (-95, 57))
        page.until_under(10, x - 115, y + 67)
        finger("touchEnd")
        page.frames(3)
        assert page.get("pbd.held") == 10, "what was taken by a tap is let go of by one"
        page.page.touchscreen.tap(x - 115, y + 67)
        page.until("pbd.held === -1")
        page.pause()
        page.until("pbd.shown === pbd.frame")
        x, y = page.place(10)
        drag((x, y), (-30, 20))
        page.until("pbd.held === 10")
        page.go_on()
        page.until_under(10, x - 30, y + 20)
        finger("touchEnd")
        page.until("pbd.held === -1")
        forward = page.get("pbd.camera.forward")
        drag((60, 500), (80, 0), 8)
        finger("touchEnd")
        assert np.linalg.norm(np.subtract(page.get("pbd.camera.forward"), forward)) > 0.2, "otherwise it turns the view"
        scale = page.get("pbd.camera.scale")
        finger("touchStart", (200, 500), (300, 500))
        for k in range(8):
            finger("touchMove", (200 - 10 * k, 500), (300 + 10 * k, 500))
        finger("touchEnd")
        assert page.get("pbd.camera.scale") > 1.5 * scale, "two fingers zoom"


def heap():
    """Three balls on the ground, in space."""
    builder = pbd.ModelBuilder()
    builder.add_particles([(0, 0.1, 0), (0.3, 0.1, 0.2), (-0.2, 0.1, 0.4)], radius=0.1)
    builder.add_plane((0, 0, 0), (0, 1, 0), friction=0.5)
    return builder


def test_a_scene_in_space_has_a_perspective_camera_and_its_ground(open_page, tmp_path):
    builder = heap()
    session = Session(pbd.Scene(builder, substeps=4, name="heap"), "heap.py")
    with served(session) as server:
        page = open_page(server)
        assert page.get("pbd.camera.ortho") is False
        page.pause()
        x, y = page.place(0)
        pixels = shot_of(page, tmp_path)
        assert pixels[round(y), round(x)][0] > 1.3 * pixels[round(y), round(x)][2]
        ground = np.abs(pixels[200:500, 50:560] - BACK["light"]).max(axis=2) > 0.02
        assert ground.mean() > 0.02, "a grid is drawn"
        page.page.mouse.move(30, 500)
        page.page.mouse.down()
        page.page.mouse.move(120, 480, steps=4)
        page.page.mouse.up()
        page.click_on(1)


def test_where_there_is_no_ground_none_is_drawn(open_page, tmp_path):
    with served(session_of("rope")) as server:
        page = open_page(server)
        pixels = shot_of(page, tmp_path)
        below = pixels[440:480, 100:560]
        assert np.abs(below - BACK["light"]).max() < 0.02


@pytest.mark.skipif(not (shutil.which("firefox-esr") and shutil.which("xvfb-run")), reason="needs firefox-esr and xvfb")
def test_firefox_shows_it_too(tmp_path):
    """As Debian packages it: it draws, and says what has arrived. On a display of its own, drawn by Mesa's software, as
    this Firefox has no WebGL2 with --headless."""
    session = session_of("collision")
    with served(session) as server:
        profile = tmp_path / "profile"
        profile.mkdir()
        (profile / "user.js").write_text('user_pref("webgl.force-enabled", true);\n')
        command = ["xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "firefox-esr", "--no-remote"]
        environment = {**os.environ, "HOME": str(tmp_path), "LIBGL_ALWAYS_SOFTWARE": "1"}
        firefox = subprocess.Popen(
            [*command, "--profile", profile, server.url], env=environment, stderr=subprocess.DEVNULL,
            start_new_session=True,
        )  # fmt: skip
        try:
            end = time.monotonic() + 90
            while server.frames_sent.get(1, 0) < 30:
                assert time.monotonic() < end, f"it does not say that frames arrive: {server.frames_sent}"
                time.sleep(0.2)
        finally:
            os.killpg(firefox.pid, signal.SIGTERM)  # xvfb-run's display goes with it
            firefox.wait()
