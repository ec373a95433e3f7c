"""Real time: when frames are due, and what is said of a simulation that is slow."""

import pytest

from pbd_warp.view.pace import SLACK, Pace


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
