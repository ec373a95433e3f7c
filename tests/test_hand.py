"""The hand and the camera through which it sees: picking, leading in the plane that faces the camera, letting go."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import rope_model, state

import pbd_warp as pbd
from pbd_warp.grab.camera import Camera
from pbd_warp.grab.grabber import REACH, Grabber

SIZE = (800.0, 600.0)


def camera(eye=(0, 0, 3), forward=(0, 0, -1), up=(0, 1, 0), field_of_view=0.8, size=SIZE):
    return Camera(eye, forward, up, field_of_view, size)


def no_radius(sim):
    return np.zeros(sim.model.particle_count)


directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.1)


@given(directions, directions, st.tuples(*[st.floats(-5, 5)] * 3), st.tuples(*[st.floats(0, 600)] * 2))
def test_a_place_on_the_screen_and_its_point_in_the_facing_plane_are_the_same(forward, up, eye, at):
    if np.linalg.norm(np.cross(forward, up)) < 0.05:
        return
    seen_by = camera(eye, forward, up)
    through = np.asarray(eye) + 2.5 * seen_by.forward + 0.3 * seen_by.right
    point = seen_by.on_facing_plane(at, through)
    np.testing.assert_allclose(seen_by.project(point[None])[0], at, atol=1e-6)
    np.testing.assert_allclose((point - through) @ seen_by.forward, 0.0, atol=1e-9)


def test_projection_by_hand():
    """A point one metre to the right and half a metre up, four metres away: pixels by similar triangles."""
    seen_by = camera(eye=(0, 0, 4), field_of_view=2.0 * np.arctan(0.5))  # 600 px are 1 m at 1 m, so 4 m at 4 m
    np.testing.assert_allclose(seen_by.project(np.array([[1.0, 0.5, 0.0]])), [[400 + 150, 300 - 75]], atol=1e-9)
    assert np.isnan(seen_by.project(np.array([[0.0, 0.0, 5.0]]))).all(), "behind the camera"


@pytest.mark.parametrize(("away", "picked"), [(REACH - 0.01, 0), (REACH + 0.01, None)])
@pytest.mark.parametrize("direction", [(1, 0), (0, -1), (0.6, 0.8)])
def test_picks_within_14_pixels(away, picked, direction):
    x = np.array([[0.0, 0.0, 0.0]])
    at = camera().project(x)[0] + away * np.array(direction)
    assert REACH == 14.0
    assert camera().pick(x, np.zeros(1), at, REACH) == picked


def test_picks_the_nearest_and_on_ties_the_front_most():
    x = np.array([[0.0, 0, 0], [0.02, 0, 0], [0.0, 0, -1], [0.0, 0, 1]])
    at = camera().project(x)
    assert camera().pick(x, np.zeros(4), at[1] + 1.0, REACH) == 1
    assert camera().pick(x, np.zeros(4), at[0], REACH) == 3, "three in a row: the one in front"
    assert camera().pick(x[[3, 2, 0]], np.zeros(3), at[0], REACH) == 0
    assert camera().pick(x, np.zeros(4), at[0] - [3, 0], REACH) == 3


def test_a_particle_is_picked_anywhere_on_its_disc_and_the_front_most_disc_wins():
    x = np.array([[0.0, 0, 0], [0.3, 0, -1.0]])
    radius = np.array([0.4, 0.5])
    seen_by = camera()
    edge = seen_by.project(np.array([[0.37, 0.0, 0.0]]))[0]
    assert np.linalg.norm(edge - seen_by.project(x)[0]) > 5 * REACH
    assert seen_by.pick(x, radius, edge, REACH) == 0, "its centre is further away, but it is in front"
    beside = seen_by.project(np.array([[0.6, 0.0, -1.0]]))[0]
    assert seen_by.pick(x, radius, beside, REACH) == 1


def test_what_is_behind_the_camera_is_not_picked():
    x = np.array([[0.0, 0, 6.0]])
    assert camera().pick(x, np.ones(1), (400, 300), REACH) is None


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        ({"eye": (0, 0, np.nan)}, "eye must be finite"),
        ({"eye": (0, 0, 1e7)}, "eye must be within"),
        ({"forward": (0, 0, 0)}, "forward must have a direction"),
        ({"forward": (0, 2, 0)}, "up must not point along forward"),
        ({"up": (0, 0)}, "shape"),
        ({"field_of_view": 0.0}, "field_of_view"),
        ({"field_of_view": 3.2}, "field_of_view"),
        ({"size": (0, 100)}, "size must be at least one pixel"),
        ({"size": (100,)}, "size must be two numbers"),
        ({"size": (1e9, 100)}, "size must be within"),
    ],
)
def test_bad_cameras(broken, message):
    with pytest.raises(pbd.InputError, match=message):
        camera(**broken)


def test_click_move_click():
    """Select, move with no button held, let go: the particle is under the cursor, then free."""
    sim = pbd.Simulation(rope_model(3, gravity=(0, -1, 0)), substeps=4)
    said = []
    grabber = Grabber(sim, lambda *gesture: said.append(gesture))
    seen_by = camera(eye=(0.5, 0, 3))
    radius = no_radius(sim)
    grabber.click(seen_by, (5, 5), radius)
    assert grabber.particle is None
    at = seen_by.project(state(sim)[0])[2]
    grabber.click(seen_by, (at[0] + 3, at[1] - 4), radius)
    assert grabber.particle == 2
    sim.step()
    np.testing.assert_array_equal(state(sim)[0][2], (1, 0, 0))  # it stays until it is moved
    for step in range(1, 11):
        cursor = (at[0] - 4.0 * step, at[1] + 2.0 * step)
        grabber.hover(seen_by, cursor)
        sim.step()
        np.testing.assert_allclose(seen_by.project(state(sim)[0])[2], cursor, atol=1e-6)
        np.testing.assert_allclose(state(sim)[0][2, 2], 0.0, atol=1e-12)
    assert abs(state(sim)[0][1, 1]) > 0.05, "its neighbour follows"
    grabber.click(seen_by, (5, 5), radius)
    assert grabber.particle is None
    grabber.hover(seen_by, at)
    before = state(sim)[0][2]
    sim.step()
    assert state(sim)[0][2, 1] < before[1], "it falls"
    assert [gesture[0] for gesture in said] == ["select", *["move"] * 10, "deselect"]
    assert said[0][1] == 2


def test_moves_in_the_plane_that_faces_the_camera_wherever_that_is_now():
    sim = pbd.Simulation(rope_model(2, pinned=(), gravity=(0, 0, 0)))
    grabber = Grabber(sim)
    grabber.select(1)
    aside = camera(eye=(4, 1, 1), forward=(-1, -0.3, -0.2))
    grabber.hover(aside, (500, 200))
    sim.step()
    first = state(sim)[0][1]
    np.testing.assert_allclose((first - (1, 0, 0)) @ aside.forward, 0.0, atol=1e-12)
    above = camera(eye=(1, 3, 0), forward=(0, -1, 0), up=(0, 0, -1))
    grabber.hover(above, (450, 350))
    sim.step()
    second = state(sim)[0][1]
    np.testing.assert_allclose(second[1], first[1], atol=1e-12)
    np.testing.assert_allclose(above.project(second[None])[0], (450, 350), atol=1e-6)
    with pytest.raises(pbd.InputError, match="behind"):
        grabber.hover(camera(eye=(0, 0, -9)), (1, 1))


def test_a_recorded_drag_goes_through_the_hand(monkeypatch):
    gestures = []
    for name in ("select", "move", "deselect"):
        done = getattr(Grabber, name)
        monkeypatch.setattr(Grabber, name, lambda self, *a, n=name, d=done: (gestures.append(n), d(self, *a)))
    drag = pbd.Drag([(0.0, "select", 2), (0.1, "move", (1, 1, 0)), (0.2, "deselect")])
    sim = pbd.Simulation(rope_model(3), dt=0.1)
    for _ in range(4):
        drag.advance(sim).step()
    assert gestures == ["select", "move", "move", "deselect"]
