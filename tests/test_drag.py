"""Grabbing in code and by script: continuous, exact, and let go of cleanly."""

import numpy as np
import pytest
from models import rope_model, state

import pbd_warp as pbd


def test_a_grabbed_particle_moves_evenly_over_the_substeps(monkeypatch):
    sim = pbd.Simulation(rope_model(3), substeps=4, capture=False)
    seen = []
    update = sim._loop.integrator.update
    monkeypatch.setattr(sim._loop.integrator, "update", lambda stage: (update(stage), seen.append(state(sim)[0][2])))
    sim.grab(2)
    sim.move_to((1.0, 0.4, 0.0))
    sim.step()
    np.testing.assert_allclose(seen, [(1, 0.1, 0), (1, 0.2, 0), (1, 0.3, 0), (1, 0.4, 0)], atol=1e-15)


def test_a_grabbed_particle_stays_until_it_is_moved_and_flies_on_when_let_go():
    sim = pbd.Simulation(rope_model(2, pinned=(), gravity=(0, 0, 0)))
    sim.grab(1)
    sim.step()
    np.testing.assert_array_equal(state(sim)[0][1], (1, 0, 0))
    sim.move_to((1.0, 0.0, 0.1))
    sim.step()
    np.testing.assert_allclose(state(sim)[1][1], (0, 0, 6), atol=1e-12)
    sim.release()
    np.testing.assert_array_equal(sim._context.w.numpy(), sim.model.w)
    sim.step()
    assert state(sim)[0][1, 2] > 0.1


def test_a_fixed_particle_can_be_led_elsewhere_and_stays_there():
    sim = pbd.Simulation(rope_model(3))
    sim.grab(0)
    sim.move_to((0.0, 1.0, 0.0))
    sim.step()
    sim.release()
    for _ in range(3):
        sim.step()
    np.testing.assert_array_equal(state(sim)[0][0], (0, 1, 0))
    np.testing.assert_array_equal(state(sim)[1][0], 0.0)


def test_grabbing_another_lets_go_of_the_first():
    sim = pbd.Simulation(rope_model(3))
    sim.grab(1)
    sim.grab(2)
    assert sim._context.w.numpy()[1] == sim.model.w[1]
    assert sim._context.w.numpy()[2] == 0.0
    sim.release()
    sim.release()
    np.testing.assert_array_equal(sim._context.w.numpy(), sim.model.w)


def test_a_script_leads_in_straight_lines_from_move_to_move():
    drag = pbd.Drag([(0.1, "select", 2), (0.2, "move", (1, 1, 0)), (0.4, "move", (0.5, 1, 0)), (0.5, "deselect")])
    sim = pbd.Simulation(rope_model(3, gravity=(0, 0, 0)), dt=0.05)
    seen, held = [], []
    for _ in range(12):
        drag.advance(sim)
        held.append(sim.held)
        sim.step()
        seen.append(state(sim)[0][2])
    assert held == [None] * 2 + [2] * 8 + [None] * 2
    expected = [(1, 0, 0), (1, 0, 0), (1, 0.5, 0), (1, 1, 0), (0.875, 1, 0), (0.75, 1, 0), (0.625, 1, 0), (0.5, 1, 0)]
    np.testing.assert_allclose(seen[:8], expected, atol=1e-12)
    np.testing.assert_allclose(seen[9], (0.5, 1, 0), atol=1e-12)


def test_select_takes_over_from_another_select():
    drag = pbd.Drag([(0.0, "select", 1), (0.1, "select", 2), (0.2, "deselect"), (0.3, "select", 1)])
    sim = pbd.Simulation(rope_model(3), dt=0.1)
    held = []
    for _ in range(5):
        drag.advance(sim)
        held.append(sim.held)
        sim.step()
    assert held == [1, 2, None, 1, 1]


@pytest.mark.parametrize(
    ("gestures", "message"),
    [
        ([(0, "push", 1)], "gesture 'push': there is select, move, deselect"),
        ([(0,)], "there is select"),
        ([(0, "move", (0, 0, 0))], "move without a selected particle"),
        ([(0, "select", 0), (1, "deselect"), (2, "deselect")], "gesture 2: deselect without a selected particle"),
        ([(1, "select", 0), (0.5, "move", (0, 0, 0))], "goes forward in time"),
        ([(0, "select")], "write .time, 'select', particle."),
        ([(0, "select", -1)], "particle must be at least 0"),
        ([(0, "select", 0), (1, "move", (0, float("nan"), 0))], "position must be finite"),
        ([(-1, "select", 0)], "time must be"),
    ],
)
def test_bad_scripts(gestures, message):
    with pytest.raises(pbd.InputError, match=message):
        pbd.Drag(gestures)


def test_from_selection_to_the_first_move_the_way_is_straight_and_even():
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particle((0, 0, 0))
    sim = pbd.Simulation(builder.finalize(dtype="float64"), dt=0.1)
    drag = pbd.Drag([(0.0, "select", 0), (1.0, "move", (1.0, 0.5, 0.0))])
    for frame in range(1, 11):
        drag.advance(sim)
        sim.step()
        np.testing.assert_allclose(sim.state.x.numpy()[0], (0.1 * frame, 0.05 * frame, 0.0), atol=1e-12)
