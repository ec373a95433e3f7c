"""The page's modules by themselves, in headless Chromium: camera, picking, the even pace of what is shown."""

import json

import numpy as np
import pytest
from browser import served
from pages import session_of


@pytest.fixture
def evaluate(open_page):
    """Runs JavaScript with the page's modules: `camera`, an 800 x 600 camera; `Playhead`."""
    with served(session_of("worm")) as server:
        page = open_page(server).page

        def run(body, **values):
            return page.evaluate(
                f"""async () => {{
                    const {{ Camera }} = await import("./camera.js");
                    const {{ Playhead }} = await import("./play.js");
                    const camera = new Camera();
                    camera.resize(800, 600);
                    const given = {json.dumps(values)};
                    {body}
                }}"""
            )

        yield run


@pytest.mark.parametrize("ortho", [True, False])
def test_a_place_on_the_canvas_and_its_point_in_the_facing_plane_are_the_same(ortho, evaluate, rng):
    for _ in range(10):
        yaw, pitch = rng.uniform(-3, 3), rng.uniform(-1.5, 1.5)
        at, through = rng.uniform(0, 600, 2).tolist(), rng.uniform(-1, 1, 3).tolist()
        point, place, forward = evaluate(
            """Object.assign(camera, { ortho: given.ortho, yaw: given.yaw, pitch: given.pitch });
            camera.fit([-1, -1, -1], [1, 1, 1]);
            const point = camera.unproject(given.at, given.through);
            return [point, camera.project(point, 0), camera.forward];""",
            **{"ortho": ortho, "yaw": yaw, "pitch": pitch, "at": at, "through": through},
        )
        np.testing.assert_allclose(place[:2], at, atol=1e-6)
        np.testing.assert_allclose(np.subtract(point, through) @ forward, 0.0, atol=1e-9)


def test_projection_by_hand(evaluate):
    """A metre to the right and half a metre up, four metres away: pixels by similar triangles."""
    tan = np.tan(0.35)
    place = evaluate("camera.distance = 4; camera.update(); return camera.project([1, 0.5, 0], 0);")
    np.testing.assert_allclose(place, [400 + 300 / tan / 4, 300 - 150 / tan / 4, 4.0], rtol=1e-12)
    place = evaluate(
        "Object.assign(camera, { distance: 4, ortho: true }); camera.update(); return camera.project([1, 0.5, -7], 0);"
    )
    np.testing.assert_allclose(place[:2], [400 + 300 / tan / 4, 300 - 150 / tan / 4], rtol=1e-12)


@pytest.mark.parametrize(("away", "picked"), [(13.99, 0), (14.01, -1)])
@pytest.mark.parametrize("direction", [(1, 0), (0, -1), (0.6, 0.8)])
def test_picks_within_14_pixels(away, picked, direction, evaluate):
    body = """const [x, y] = camera.project([0, 0, 0], 0);
        return camera.nearest([0, 0, 0], [0], [x + given.dx, y + given.dy]);"""
    assert evaluate(body, dx=away * direction[0], dy=away * direction[1]) == picked


@pytest.mark.parametrize(
    ("positions", "radius", "aim", "picked"),
    [
        ([(0, 0, 0), (0.02, 0, 0)], [0, 0], (0.02, 0, 0), 1),
        ([(0, 0, 0), (0, 0, -1), (0, 0, 1)], [0, 0, 0], (0, 0, 0), 2),  # in a row: the one in front
        ([(0, 0, 1), (0, 0, -1), (0, 0, 0)], [0, 0, 0], (0, 0, 0), 0),
        ([(0, 0, 0), (0.3, 0, -1)], [0.4, 0.5], (0.37, 0, 0), 0),  # discs: its centre is further, but it is in front
        ([(0, 0, 0), (0.3, 0, -1)], [0.4, 0.5], (0.6, 0, -1), 1),
        ([(0, 0, 6)], [1], (0, 0, 0), -1),  # behind the camera
    ],
)
def test_picks_the_nearest_and_on_ties_the_front_most(positions, radius, aim, picked, evaluate):
    body = "const [x, y] = camera.project(given.aim, 0); return camera.nearest(given.x.flat(), given.radius, [x, y]);"
    assert evaluate(body, x=positions, radius=radius, aim=aim) == picked


SHOW = """const head = new Playhead();
    const shown = [];
    let next = 0;
    for (let k = 0; k < given.pictures; k++) {
      const now = k / 60;
      while (next < given.arrivals.length && given.arrivals[next][1] <= now) {
        const [number, time] = given.arrivals[next++];
        head.add(number, new Float32Array([number, 0, 0]), time);
      }
      const frame = head.show(now);
      if (frame) shown.push(frame.x[0]);
    }
    return shown;"""


@pytest.mark.parametrize(
    ("rate", "skip", "jitter"),
    [(60.0, 1, 0.0), (60.0, 1, 0.012), (20.0, 1, 0.01), (60.0, 3, 0.01), (24.0, 1, 0.01)],
)
def test_frames_are_shown_at_an_even_rate(rate, skip, jitter, evaluate, rng):
    """Frames that arrive unevenly, slowly, or every third only: each picture is as much further as the one before."""
    numbers = np.arange(0, int(4 * rate), skip)
    times = 0.1 + numbers / rate + rng.uniform(0, jitter, len(numbers))
    shown = np.array(evaluate(SHOW, pictures=230, arrivals=np.stack([numbers, times], axis=1).tolist()))
    steps = np.diff(shown[60:])  # after a second
    assert np.all(steps >= 0.0), "never back"
    even = rate / 60.0
    assert np.mean(steps) == pytest.approx(even, rel=0.01)
    assert np.abs(steps - even).max() < 0.1 * even, "nothing jerks"
    newest = np.array([numbers[times <= k / 60].max() for k in range(len(shown) - 100, len(shown))])
    # `shown` begins with the first frame, some pictures after the clock.
    late = (newest - shown[-100:]) / rate
    assert late.max() < 0.05 + 2.5 * skip / rate, "and not long after it has arrived"


def test_what_stands_still_is_the_newest_frame(evaluate):
    body = """const head = new Playhead();
        for (let k = 0; k < 5; k++) head.add(k, new Float32Array([k, 0, 0]), k / 60);
        const still = head.show(5 / 60, true).x[0];
        head.add(2, new Float32Array([2, 0, 0]), 6 / 60);
        return [still, head.show(7 / 60).x[0], head.show(8 / 60).number];"""
    assert evaluate(body) == [4, 2, 2], "and after a step back it begins anew"
