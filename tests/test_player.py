"""The player: a motion as one file, in real Chromium; stages that are played; videos."""

import base64
import gzip
import re
import urllib.error
import urllib.request
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from browser import ARGUMENTS, CHROMIUM, PATIENCE
from PIL import Image
from pxr import Gf, Usd, UsdGeom, Vt

import pbd_warp as pbd
from pbd_warp.player.drawn import Drawn
from pbd_warp.player.html import page
from pbd_warp.player.motion import Motion
from pbd_warp.player.render import Renderer
from pbd_warp.player.serve import PageServer
from pbd_warp.player.stage import read_motion
from pbd_warp.player.writer import MotionWriter
from pbd_warp.run import run

FPS = 30


def swing(stretched=1.0, frames=31):
    """Two links; the second ball goes along x by 1 m, the third is pulled to `stretched` times its link's length."""
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0), (2, 0, 0)], pinned=(0,), radius=0.1)
    builder.add_sphere((0, -1, 0), 0.3)
    x = np.tile(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), (frames, 1, 1))
    x[:, 1:, 1] = -np.linspace(0.0, 1.0, frames)[:, None]
    x[:, 2, 0] = 1.0 + np.linspace(1.0, stretched, frames)
    return Motion(Drawn.of_model(builder.finalize()), x.astype(np.float32), FPS, "a <swing>")


@pytest.fixture(scope="module")
def context():
    if CHROMIUM is None:
        pytest.skip("no Chromium")
    sync_api = pytest.importorskip("playwright.sync_api")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser.new_context(viewport={"width": 900, "height": 600})
        browser.close()


@pytest.fixture
def opened(context, tmp_path):
    pages = []

    def open_motion(motion):
        path = tmp_path / "m.html"
        motion.save(path)
        shown = context.new_page()
        shown.set_default_timeout(PATIENCE)
        pages.append(shown)
        shown.wrong = []
        shown.asked = []
        shown.on("pageerror", lambda error: shown.wrong.append(str(error)))
        shown.on("console", lambda said: said.type == "error" and shown.wrong.append(said.text))
        shown.on("request", lambda request: shown.asked.append(request.url))
        shown.goto(path.as_uri())
        shown.wait_for_function("window.pbd && pbd.ready")
        return shown

    yield open_motion
    for shown in pages:
        assert shown.wrong == []
        assert all(url.startswith(("file:", "data:")) for url in shown.asked), "the page asked the network"
        shown.close()


def frame_of(shown):
    return shown.evaluate("pbd.frame")


def test_the_page_plays_to_the_end_and_again(opened):
    motion = swing()
    shown = opened(motion)
    assert shown.title() == "a <swing>"
    shown.wait_for_function("!pbd.playing")
    assert frame_of(shown) == 30
    assert shown.locator("#clock").inner_text() == "1.00 of 1.00 s"
    shown.keyboard.press("Space")
    shown.wait_for_function("pbd.playing && pbd.frame > 0 && pbd.frame < 30")
    shown.keyboard.press("Space")
    assert not shown.evaluate("pbd.playing")


def test_the_page_scrubs_between_frames_and_steps(opened):
    motion = swing()
    shown = opened(motion)
    shown.locator("#time").fill("12.25")
    shown.wait_for_function("!pbd.playing && pbd.frame === 12.25")
    shown.wait_for_function(f"Math.abs(pbd.positions[4] + {12.25 / 30}) < 1e-6")
    np.testing.assert_allclose(
        np.reshape(shown.evaluate("pbd.positions"), (3, 3)),
        0.75 * motion.positions[12] + 0.25 * motion.positions[13],
        atol=1e-6,
    )
    shown.locator("#stage").focus()
    shown.keyboard.press("ArrowRight")
    assert frame_of(shown) == 13
    shown.keyboard.press("Home")
    assert frame_of(shown) == 0


def test_the_page_turns_and_fits(opened):
    shown = opened(swing())
    before = shown.evaluate("pbd.camera.forward")
    shown.mouse.move(400, 250)
    shown.mouse.down()
    shown.mouse.move(500, 280, steps=4)
    shown.mouse.up()
    assert np.linalg.norm(np.subtract(shown.evaluate("pbd.camera.forward"), before)) > 0.3
    shown.locator("#fit").click()
    np.testing.assert_allclose(shown.evaluate("pbd.camera.forward"), before, atol=1e-9)


def test_the_page_colours_by_stretch(opened):
    """Of the links: a link that is pulled to twice its length is red at the end, and none was before it was asked."""
    shown = opened(swing(stretched=2.0))
    shown.evaluate("pbd.go(30)")
    shown.keyboard.press("Space")

    shown.keyboard.press("End")
    plain = redness(shown)
    shown.locator("#colour").select_option("stretch")
    assert redness(shown) > plain + 300
    legend = shown.locator("#legend").inner_text().replace("\N{MINUS SIGN}", "-")
    assert legend.split() == ["-100", "%", "+100", "%", "of", "rest", "length"]
    assert shown.evaluate("pbd.most.stretch") == pytest.approx(1.0, abs=1e-6)
    assert not shown.locator("#colour [value=tension]").is_visible()


def redness(shown):
    """Pixels in the colour of what is pulled most."""
    shown.wait_for_timeout(300)
    picture = shown.locator("#stage").screenshot()
    pixels = np.asarray(Image.open(BytesIO(picture)).convert("RGB")).astype(int)
    return int(np.sum((pixels[..., 0] > 140) & (pixels[..., 1] < 90) & (pixels[..., 2] < 90)))


def test_the_page_colours_by_tension(opened):
    """Links do not stretch here; the lower one is pulled with 3 N at the end, and nothing else is."""
    motion = swing()
    tension = np.zeros((31, 2), np.float32)
    tension[:, 1] = np.linspace(-1.0, 3.0, 31)
    shown = opened(replace(motion, tension=tension))
    shown.keyboard.press("End")
    plain = redness(shown)
    shown.locator("#colour").select_option("tension")
    red = redness(shown)
    assert red > plain + 300
    legend = shown.locator("#legend").inner_text().replace("\N{MINUS SIGN}", "-")
    assert legend.split() == ["-5", "N", "+5", "N", "pull", "and", "push"]
    assert shown.evaluate("pbd.most.tension") == 3.0
    shown.locator("#time").fill("12.25")
    shown.wait_for_function("pbd.frame === 12.25 && !pbd.playing")
    shown.wait_for_function(f"Math.abs(pbd.tension[1] - {-1.0 + 4.0 * 12.25 / 30}) < 1e-5 && pbd.tension[0] === 0")
    assert redness(shown) - plain < 0.1 * (red - plain)


def test_tensions_in_the_page_are_those_of_the_simulation(tmp_path):
    """Of a rope at rest: what hangs below each link."""
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, -k, 0) for k in range(4)], mass=[0.0, 1.0, 2.0, 4.0], pinned=(0,))
    run(pbd.Scene(builder, frames=3, method="direct"), tmp_path / "t.html", dtype="float64")
    run(pbd.Scene(builder, frames=3, method="jacobi"), tmp_path / "j.html", dtype="float64")
    text = (tmp_path / "t.html").read_text()
    packed = re.search(r'id="tension">([^<]*)<', text)[1]
    tension = np.frombuffer(gzip.decompress(base64.b64decode(packed)), "<f4").reshape(3, 3)
    np.testing.assert_allclose(tension[1:], [9.81 * np.array([7.0, 6.0, 4.0])] * 2, rtol=1e-6)
    np.testing.assert_array_equal(tension[0], 0.0)
    assert '"has_tension": true' in text
    assert '"has_tension": false' in (tmp_path / "j.html").read_text()
    motion = pbd.Simulation(builder, method="direct").run(frames=2)
    np.testing.assert_allclose(motion.tension[2], 9.81 * np.array([7.0, 6.0, 4.0]), rtol=1e-5)


def test_the_frames_in_the_page_are_those_of_the_simulation(tmp_path):
    scene = pbd.load_scene("rope").changed(frames=20)
    run(scene, tmp_path / "r.html")
    run(scene, tmp_path / "r.usda")
    text = (tmp_path / "r.html").read_text()
    packed = re.search(r'id="frames">([^<]*)<', text)[1]
    x = np.frombuffer(gzip.decompress(base64.b64decode(packed)), "<f4").reshape(20, 21, 3)
    stage = Usd.Stage.Open(str(tmp_path / "r.usda"))
    points = UsdGeom.Points.Get(stage, "/World/Particles").GetPointsAttr()
    np.testing.assert_array_equal(x, [points.Get(frame) for frame in range(20)])
    assert "http" not in text
    assert not re.search(r"^(import|export) ", text, re.MULTILINE)


def test_a_run_that_fails_keeps_its_frames_and_replaces_nothing(tmp_path):
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 0, 0), velocity=(1e38, 0, 0))
    scene = pbd.Scene(builder, frames=600)
    for name in ("far.html", "far.partial.html"):
        with pytest.raises(pbd.SimulationFailed, match=f"frames so far are in .*{name}"):
            run(scene, tmp_path / "far.html")
        assert '"frames": ' in (tmp_path / name).read_text()


def test_what_we_write_is_what_we_play(tmp_path):
    scene = pbd.load_scene("collision").changed(frames=5)
    run(scene, tmp_path / "c.usda")
    motion, hidden = read_motion(tmp_path / "c.usda")
    assert hidden == {}
    stage = Usd.Stage.Open(str(tmp_path / "c.usda"))
    points = UsdGeom.Points.Get(stage, "/World/Particles")
    np.testing.assert_array_equal(motion.positions, [points.GetPointsAttr().Get(frame) for frame in range(5)])
    np.testing.assert_allclose(2.0 * motion.drawn.radius, points.GetWidthsAttr().Get())
    assert len(motion.drawn.plane_point) == 4
    assert motion.fps == scene.fps


CONTROL = np.array([[0.0, 0, 0], [1, 2, 0], [3, 3, 0], [4, 0, 0], [6, -1, 0], [7, 1, 0], [8, 0, 0]])


def bezier(t):
    a, b, c, d = CONTROL[:4]
    return (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * b + 3 * t * t * (1 - t) * c + t**3 * d


def de_boor(t):
    """The first span of a uniform cubic B-spline, by blossoming."""
    knots, d = np.arange(-3, 5), list(CONTROL[:4])
    for r in range(1, 4):
        for j in range(3, r - 1, -1):
            alpha = (t - knots[j]) / (knots[j + 4 - r] - knots[j])
            d[j] = (1 - alpha) * d[j - 1] + alpha * d[j]
    return d[3]


def catmull_rom(t):
    """Barry and Goldman's pyramid with uniform knots."""
    p, k = CONTROL[:4], np.arange(-1.0, 3.0)
    a = [((k[i + 1] - t) * p[i] + (t - k[i]) * p[i + 1]) / (k[i + 1] - k[i]) for i in range(3)]
    b = [((k[i + 2] - t) * a[i] + (t - k[i]) * a[i + 1]) / (k[i + 2] - k[i]) for i in range(2)]
    return ((k[2] - t) * b[0] + (t - k[1]) * b[1]) / (k[2] - k[1])


@pytest.mark.parametrize(("basis", "curve"), [("bezier", bezier), ("bspline", de_boor), ("catmullRom", catmull_rom)])
def test_curves_of_any_stage_come_upright_and_in_metres(tmp_path, basis, curve):
    """Centimetres, z up, within a moving Xform: the points drawn are on the curve as each basis defines it."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "s.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 0.01)
    stage.SetStartTimeCode(10)
    stage.SetEndTimeCode(11)
    stage.SetTimeCodesPerSecond(24)
    move = UsdGeom.Xform.Define(stage, "/Group").AddTranslateOp()
    move.Set(Gf.Vec3d(0, 0, 0), 10)
    move.Set(Gf.Vec3d(0, 0, 100), 11)
    curves = UsdGeom.BasisCurves.Define(stage, "/Group/Cable")
    curves.CreateTypeAttr("cubic")
    curves.CreateBasisAttr(basis)
    curves.CreateCurveVertexCountsAttr([len(CONTROL)])
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(CONTROL.astype(np.float32)))
    curves.CreateWidthsAttr([2.0])
    curves.SetWidthsInterpolation("constant")
    UsdGeom.Mesh.Define(stage, "/Ground")
    stage.Save()
    motion, hidden = read_motion(tmp_path / "s.usda")
    assert hidden == {"Mesh": 1}
    assert (motion.frame_count, motion.fps) == (2, 24)
    expected = np.array([curve(t) for t in (0.0, 0.25, 0.5, 0.75, 1.0)])
    upright = 0.01 * np.stack([expected[:, 0], expected[:, 2], -expected[:, 1]], axis=1)
    np.testing.assert_allclose(motion.positions[0, :5], upright, atol=1e-6)
    np.testing.assert_allclose(
        motion.positions[1] - motion.positions[0], np.tile([0, 1.0, 0], (motion.positions.shape[1], 1)), atol=1e-6
    )
    np.testing.assert_allclose(motion.drawn.link_radius, 0.01)
    assert np.all(motion.drawn.radius < 0.01), "balls would hide the links"
    np.testing.assert_array_equal(motion.drawn.links[:, 1] - motion.drawn.links[:, 0], 1)


def test_a_stage_with_nothing_to_play_is_refused(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "m.usda"))
    UsdGeom.Mesh.Define(stage, "/Ground")
    stage.Save()
    with pytest.raises(pbd.InputError, match="neither points nor curves"):
        read_motion(tmp_path / "m.usda")
    (tmp_path / "text.usda").write_text("no stage")
    with pytest.raises(pbd.InputError, match="no USD stage"):
        read_motion(tmp_path / "text.usda")
    with pytest.raises(pbd.InputError, match="no file"):
        read_motion(tmp_path / "none.usda")


def test_a_picture_shows_each_ball_where_the_camera_sees_it():
    """Face-on, a motion in the plane z = 0: what changes when a ball goes away is a disc around its place."""
    motion = swing()
    x = motion.positions[0].copy()
    x[2] = x[1] + [0.5, -0.5, 0.0]
    gone = x.copy()
    gone[2] = [0.0, 1000.0, 0.0]
    alone = Drawn(**{**vars(motion.drawn), "links": np.zeros((0, 2), int), "link_radius": np.zeros(0)})
    renderer = Renderer(alone, motion.drawn.around(motion.positions), 640, 360)
    rows, columns = np.nonzero(np.any(renderer.draw(x) != renderer.draw(gone), axis=2))
    # The picture shows 1.12 times the motion.
    low, high = np.array(motion.drawn.around(motion.positions)["low"]), motion.drawn.around(motion.positions)["high"]
    scale = min(640 / (high[0] - low[0]), 360 / (high[1] - low[1])) / 1.12
    px, py = 320 + scale * (x[2, 0] - 0.5 * (low[0] + high[0])), 180 - scale * (x[2, 1] - 0.5 * (low[1] + high[1]))
    radius = 0.1 * scale
    assert abs(0.5 * (columns.min() + columns.max() + 1) - px) < 1.0
    assert abs(columns.max() + 1 - columns.min() - 2.0 * radius) < 2.0
    assert abs(0.5 * (rows.min() + rows.max() + 1) - py) < 1.0
    assert abs(len(rows) - np.pi * radius**2) < 0.1 * np.pi * radius**2


def test_a_ball_within_another_is_not_seen():
    """Though its centre is nearer, and it is drawn later: depth is compared pixel by pixel."""
    nothing = np.zeros((0, 3))
    drawn = Drawn(
        radius=np.array([1.0, 0.1]), fixed=np.array([1]), links=np.zeros((0, 2), int), link_radius=np.zeros(0),
        rest_length=np.zeros(0), plane_point=nothing, plane_normal=nothing, spheres=np.zeros((0, 4)),
    )  # fmt: skip
    flat = np.zeros((1, 2, 3))
    x = np.array([[0, 0, 0], [0, 0.5, 0.2]])
    within = Renderer(drawn, drawn.around(flat), 320, 180).draw(x)
    np.testing.assert_array_equal(within, Renderer(drawn, drawn.around(flat), 320, 180).draw(x * [1, 1, -1]))
    assert np.any(within != Renderer(drawn, drawn.around(flat), 320, 180).draw(x * [1, 1, 6]))


def test_what_is_nearer_hides_what_is_behind():
    motion = swing()
    renderer = Renderer(motion.drawn, motion.drawn.around(motion.positions), 640, 360)
    x = motion.positions[0].copy()
    x[2] = x[1]
    x[1, 2], x[2, 2] = -0.5, 0.5
    (_, _), (px, py), _ = renderer.eye.project(x)[0]
    tinted = Drawn(**{**vars(motion.drawn), "fixed": np.array([0, 1])})  # the one behind in another colour
    other = Renderer(tinted, motion.drawn.around(motion.positions), 640, 360)
    at = int(py), int(px)
    np.testing.assert_array_equal(renderer.draw(x)[at], other.draw(x)[at])
    x[1, 2], x[2, 2] = 0.5, -0.5
    assert np.any(renderer.draw(x)[at] != other.draw(x)[at])


@pytest.mark.parametrize(("name", "count", "size"), [("m.mp4", 31, (1280, 720)), ("m.gif", 26, (480, 270))])
def test_videos_have_the_frames_at_the_pace(tmp_path, name, count, size):
    imageio = pytest.importorskip("imageio.v2")
    pytest.importorskip("imageio_ffmpeg")
    drawn = []
    swing().save(tmp_path / name, lambda done, of: drawn.append((done, of)))
    with imageio.get_reader(tmp_path / name) as video:
        frames = list(video.iter_data())
    assert len(frames) == count == len(drawn)
    assert drawn[-1] == (count, count)
    assert frames[0].shape[1::-1] == size
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 100, "nothing moves"


@pytest.mark.parametrize(
    ("name", "message"), [("m.avi", "must end in one of .html"), ("none/m.html", "does not exist")]
)
def test_paths_that_cannot_be_written(tmp_path, name, message):
    with pytest.raises(pbd.InputError, match=message):
        MotionWriter(tmp_path / name, pbd.load_scene("rope").builder.finalize())


def test_the_page_server_answers_this_machine_only():
    server = PageServer("<p>hello")
    assert urllib.request.urlopen(server.url).read() == b"<p>hello"
    assert server.fetched.is_set()
    for url, headers in ((server.url, {"Host": "evil.example:80"}), (server.url + "other", {})):
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(urllib.request.Request(url, headers=headers))
    server.close()


def test_a_title_or_a_scene_closes_no_script():
    motion = swing()
    around = motion.drawn.around(motion.positions)
    text = page(around, motion.positions, 30, "</script><script>alert(1)", "rest length")
    assert "</script><script>alert" not in text
