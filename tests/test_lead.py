"""Fixed particles led from place to place: exact, even, and at rest when they are led no more."""

import numpy as np
import pytest
from models import rope_model, state

import pbd_warp as pbd
from pbd_warp.step.integrators import INTEGRATORS
from pbd_warp.step.methods import METHODS

EPS = {"float32": 1.2e-7, "float64": 2.2e-16}
SUBSTEPS = 5


def place(frame):
    """Where both ends of a rope of 1 m are, a circle that closes after 40 frames, 0.2 m apart in height."""
    angle = frame * np.pi / 20
    start = np.array([0.3 * np.sin(angle), 0.3 * (1 - np.cos(angle)), 0.0])
    return np.stack([start, np.add(start, (0.9, 0.2, 0.0))])


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("method", METHODS)
def test_led_particles_are_in_their_places_at_the_end_of_every_frame(method, integrator, dtype):
    model = rope_model(6, dtype, pinned=(0, -1))
    settings = {"method": METHODS[method](iterations=8), "integrator": integrator, "on_failure": "continue"}
    sim = pbd.Simulation(model, substeps=SUBSTEPS, **settings)
    for frame in range(1, 121):
        sim.lead([0, 5], place(frame))
        sim.step()
        x, v = state(sim)
        # A rounding a substep and stage, of coordinates of size 1: not one more for being led longer.
        np.testing.assert_allclose(x[[0, 5]], place(frame), atol=5 * SUBSTEPS * EPS[dtype])
        way = (place(frame) - place(frame - 1)) / sim.dt
        if frame > 1:
            np.testing.assert_allclose(v[[0, 5]], way, atol=20 * SUBSTEPS * EPS[dtype] / sim.dt)
    assert pbd.measure(sim).max_stretch < 0.2, "the rope came along"


@pytest.mark.parametrize("integrator", ["pbd", "bdf2", "midpoint"])
def test_the_way_is_even_over_the_substeps(monkeypatch, integrator):
    sim = pbd.Simulation(rope_model(3), substeps=4, integrator=integrator, capture=False)
    seen = []
    update = sim._loop.integrator.update
    monkeypatch.setattr(sim._loop.integrator, "update", lambda stage: (update(stage), seen.append(state(sim)[0][0])))
    sim.lead([0], [(0.0, 0.4, 0.0)])
    sim.step()
    np.testing.assert_allclose(seen, [(0, 0.1, 0), (0, 0.2, 0), (0, 0.3, 0), (0, 0.4, 0)], atol=1e-15)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_they_rest_where_they_are_when_they_are_led_no_more(integrator):
    sim = pbd.Simulation(rope_model(4, pinned=(0, 3)), integrator=integrator)
    sim.lead([0, 3], [(0, 0.1, 0), (1, 0.1, 0)])
    sim.step()
    sim.lead([3], [(1, 0.2, 0)])
    for _ in range(3):
        sim.step()
    x, v = state(sim)
    np.testing.assert_allclose(x[[0, 3]], [(0, 0.1, 0), (1, 0.2, 0)], atol=1e-15)
    np.testing.assert_array_equal(v[[0, 3]], 0.0)


def test_leading_to_where_they_are_changes_nothing():
    led, still = (pbd.Simulation(rope_model(5, "float32")) for _ in range(2))
    for _ in range(20):
        led.lead([0], led.model.x[:1])
        for sim in (led, still):
            sim.step()
    np.testing.assert_array_equal(led.state.x.numpy(), still.state.x.numpy())


def test_reset_forgets_who_was_led():
    sim = pbd.Simulation(rope_model(3))
    sim.lead([0], [(0, 1, 0)])
    sim.reset()
    sim.step()
    np.testing.assert_array_equal(state(sim)[0][0], 0.0)


@pytest.mark.parametrize(
    ("particles", "positions", "message"),
    [
        ([1], [(0, 0, 0)], "particle 1 has mass"),
        ([0, 1], [(0, 0, 0)], "a position for each of 2 particles, not 1"),
        ([7], [(0, 0, 0)], "lead names particle 7"),
        ([0], [(0, np.nan, 0)], "positions must be finite"),
    ],
)
def test_bad_input(particles, positions, message):
    with pytest.raises(pbd.InputError, match=message):
        pbd.Simulation(rope_model(3)).lead(particles, positions)
