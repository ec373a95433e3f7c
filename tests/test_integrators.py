"""How velocity becomes position and back: orders, conserved quantities, frequencies, against references.py."""

import itertools

import numpy as np
import pytest
from chains import EPS, G, chain_model, every_integrator, higher_order, level, simulate
from models import rope_model, state

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.step.integrators import INTEGRATORS

# Orders.

STEPS = {
    # Long enough for the error to be above round-off, short enough for its leading term to rule.
    "pbd": (128, 256, 512, 1024),
    "bdf2": (48, 96, 192, 384),
    "midpoint": (32, 64, 128, 256),
    "midpoint4": (12, 24, 48, 96),
}


def along_the_links(model, x, v):
    """Velocities without what would stretch a link; the rest is the nearest in the norm of the kinetic energy."""
    n = len(x)
    d = np.diff(x, axis=0)
    jacobian = np.zeros((n - 1, n, 3))
    jacobian[np.arange(n - 1), np.arange(n - 1)], jacobian[np.arange(n - 1), np.arange(1, n)] = -d, d
    jacobian, w = jacobian.reshape(n - 1, -1), np.repeat(model.w, 3)
    pull = np.linalg.solve(jacobian @ (w[:, None] * jacobian.T), jacobian @ v.ravel())
    return v - (w * (jacobian.T @ pull)).reshape(v.shape)


def slopes(integrator, model, time, x, v):
    """Of position and velocity at `time`: the slopes of log error over log step.

    The velocity of "midpoint4" stretches the links by the second power of the step (its positions do not): without
    that part it is of fourth order.
    """
    errors = []
    for steps in STEPS[integrator]:
        sim = simulate(model, integrator, dt=time, substeps=steps)
        sim.step()
        assert sim.unconverged == 0
        found_x, found_v = state(sim)
        if integrator == "midpoint4":
            found_v = along_the_links(model, found_x, found_v)
        errors.append([np.linalg.norm(found_x - x), np.linalg.norm(found_v - v)])
    return -np.polyfit(np.log(STEPS[integrator]), np.log(errors), 1)[0]


@every_integrator
def test_the_order_on_a_pendulum(integrator):
    theta0, length, t, dt = 1.3, 0.8, 0.6, 1e-5
    angle = references.pendulum_angle([t - dt, t, t + dt], theta0, length)
    rate = -np.sign(theta0) * np.sqrt(2 * G / length * (np.cos(angle[1]) - np.cos(theta0)))
    assert rate == pytest.approx((angle[2] - angle[0]) / (2 * dt), rel=1e-8), "not in its first half swing"

    def place(theta):
        return length * np.array([[0, 0, 0], [np.sin(theta), -np.cos(theta), 0]])

    v = length * rate * np.array([[0, 0, 0], [np.cos(angle[1]), np.sin(angle[1]), 0]])
    found = slopes(integrator, chain_model(place(theta0), [0.0, 2.0]), t, place(angle[1]), v)
    np.testing.assert_allclose(found, INTEGRATORS[integrator].order, atol=0.15)


@every_integrator
def test_the_order_on_a_chain(integrator):
    """Three links with different masses, from level; after 0.4 s."""
    x0, masses = level(3), np.array([0.0, 1.0, 0.5, 2.0])
    model = chain_model(x0, masses)
    x, v = references.chain([0.4], x0, 0 * x0, model.w, model.gravity)
    np.testing.assert_allclose(slopes(integrator, model, 0.4, x[-1], v[-1]), INTEGRATORS[integrator].order, atol=0.15)


MEASURED = [
    ("pbd", 1, 2.33e-1),
    ("pbd", 128, 5.80e-3),
    ("bdf2", 4, 2.95e-3),
    ("bdf2", 128, 2.83e-6),
    ("midpoint", 4, 6.70e-4),
    ("midpoint", 128, 6.68e-7),
    ("midpoint4", 1, 1.92e-4),
    ("midpoint4", 2, 1.11e-5),
    ("midpoint4", 4, 7.04e-7),
]


@pytest.fixture(scope="module")
def ten_particles():
    """Level at first, 1 m and, with the fixed one, 1 kg; where they are after 1 s."""
    model = chain_model(level(9), np.r_[0.0, np.full(9, 0.1)])
    return model, references.chain([1.0], model.x, model.v, model.w, model.gravity)[0][-1]


@pytest.mark.parametrize(("integrator", "substeps", "measured"), MEASURED)
def test_the_error_of_a_swinging_chain(ten_particles, integrator, substeps, measured):
    """rms over the particles after 1 s of 60 frames, within 20 % of what was measured (references.md, case 4)."""
    model, exact = ten_particles
    sim = simulate(model, integrator, substeps=substeps)
    drift, before = 0.0, pbd.measure(sim).energy
    for _ in range(60):
        sim.step()
        assert sim.unconverged == 0
        drift = max(drift, abs(pbd.measure(sim).energy - before))
    rms = np.sqrt(np.mean(np.sum((state(sim)[0] - exact) ** 2, axis=1)))
    assert rms == pytest.approx(measured, rel=0.2)
    if integrator.startswith("midpoint"):
        # Round-off of some 5 J, once a step.
        assert drift < (1e-9 if substeps > 4 else 1e-10)
    else:
        assert drift > 1e-7, "it should lose some"


def test_a_folded_chain_falls():
    """Both ends beside each other, one is let go: against the equation of motion, shortly before it is stretched."""
    n = 10
    y = np.r_[-0.1 * np.arange(n // 2 + 1), -0.1 * np.arange(n // 2, -1, -1)]
    x0 = np.stack([np.r_[np.zeros(n // 2 + 1), np.full(n // 2 + 1, 0.05)], y, 0 * y], axis=1)
    model = chain_model(x0, np.r_[0.0, np.ones(n + 1)])
    times = np.array([0.1, 0.2, 0.3])
    x, v = references.chain(np.r_[0.0, times], x0, 0 * x0, model.w, model.gravity)
    assert x[-1, -1, 1] < -0.3, "its end has not fallen"
    sim = simulate(model, "midpoint4", dt=0.1, substeps=192)
    fine = simulate(model, "midpoint4", dt=0.1, substeps=384)
    for _ in range(3):
        sim.step()
        fine.step()
    errors = [np.abs(state(s)[0] - x[-1]).max() for s in (sim, fine)]
    assert errors[1] < 1e-6
    assert errors[1] < errors[0] / 8  # of fourth order: 16
    assert np.abs(state(fine)[1] - v[-1]).max() < 1e-3


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_the_order_on_a_spring(integrator):
    """Compliance: a mass on a spring without gravity, released at rest, 0.3 s."""
    model = chain_model([(0, 0, 0), (1.2, 0, 0)], [0.0, 2.0], gravity=(0, 0, 0), rest_length=1.0, compliance=0.01)
    exact = references.oscillator(0.3, 1.2, 2.0, 0.01, 1.0)
    errors = []
    for steps in STEPS[integrator]:
        sim = simulate(model, integrator, dt=0.3, substeps=steps)
        sim.step()
        errors.append(abs(state(sim)[0][1, 0] - exact))
    slope = -np.polyfit(np.log(STEPS[integrator]), np.log(errors), 1)[0]
    assert slope == pytest.approx(INTEGRATORS[integrator].order, abs=0.15)


# What is refused.


def spoiled(what):
    """A model, and the settings, with something of first order."""
    builder = pbd.ModelBuilder()
    x = [(0, 1, 0), (1, 1, 0)]
    builder.add_rope(x, radius=0.1, stiffness=0.5 if what == "stiffness of a distance" else 1.0)
    if what == "stiffness of a point":
        builder.add_point(1, stiffness=0.5)
    if what == "contacts":
        builder.enable_contacts()
    if what == "colliders":
        builder.add_plane((0, 0, 0), (0, 1, 0))
    return builder.finalize(), {"damping": 0.1} if what == "damping" else {}


@higher_order
@pytest.mark.parametrize(
    "what", ["contacts", "colliders", "damping", "stiffness of a distance", "stiffness of a point"]
)
def test_what_integrators_of_higher_order_cannot_carry(integrator, what):
    model, settings = spoiled(what)
    with pytest.raises(pbd.InputError, match=f"integrator '{integrator}' does not model .*{what.split()[0]}") as caught:
        pbd.Simulation(model, integrator=integrator, **settings)
    assert "\n" not in str(caught.value)
    pbd.Simulation(model, integrator="pbd", **settings).step()


def test_an_unknown_integrator():
    with pytest.raises(pbd.InputError, match=r"unknown integrator 'midpiont': .*did you mean 'midpoint'"):
        pbd.Simulation(rope_model(), integrator="midpiont")


# A grabbed particle.


@every_integrator
@pytest.mark.parametrize("method", [pbd.Jacobi(5), pbd.GaussSeidel(5), pbd.Direct()], ids=lambda m: m.name)
def test_a_grabbed_particle_is_at_its_target_at_frame_ends(integrator, method):
    sim = pbd.Simulation(rope_model(7), substeps=3, method=method, integrator=integrator, on_failure="continue")
    sim.step()
    sim.grab(4)
    for k in range(1, 6):
        start, target = state(sim)[0][4], np.array([0.6, -0.01 * k, 0.02 * k])
        sim.move_to(target)
        sim.step()
        x, v = state(sim)
        np.testing.assert_allclose(x[4], target, atol=8 * EPS["float64"])
        np.testing.assert_allclose(v[4], (target - start) * 60, atol=1e-11)


@every_integrator
def test_a_grabbed_particle_goes_evenly_over_the_substeps(integrator):
    """One frame of 5 substeps is 5 frames of one, whose targets lie evenly on the way."""
    start, target = np.array([0.5, 0.0, 0.0]), np.array([0.47, 0.05, -0.03])
    one = simulate(rope_model(7), integrator, substeps=5, on_failure="continue")
    five = simulate(rope_model(7), integrator, dt=1 / 300, on_failure="continue")
    for sim, parts in ((one, 1), (five, 5)):
        sim.grab(3)
        for k in range(parts):
            sim.move_to(start + (target - start) * (k + 1) / parts)
            sim.step()
    assert np.abs(state(one)[0] - one.model.x).max() > 0.03
    for a, b, scale in zip(state(one), state(five), (1.0, 300.0), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-13 * scale)


@higher_order
def test_a_single_particle_let_go_of_falls_from_rest(integrator):
    """Thrown down, held for one frame: of what was before nothing is left. Constant acceleration is exact, but
    for the first step of "bdf2", of first order: g h^2 / 2 too far, half as much again later."""
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 0, 0), velocity=(0, -5, 0))
    h = 1 / 60
    sim = pbd.Simulation(builder.finalize(dtype="float64"), dt=h, integrator=integrator)
    for _ in range(3):
        sim.step()
    sim.grab(0)
    sim.step()
    held = state(sim)[0][0, 1]
    sim.release()
    for k in range(1, 11):
        sim.step()
        x, v = state(sim)
        assert v[0, 1] == pytest.approx(-G * k * h, abs=1e-12)
        late = 0.75 * G * h * h if integrator == "bdf2" else 1e-13
        assert abs(x[0, 1] - held + G * (k * h) ** 2 / 2) <= late


# Capture and precision.


@every_integrator
@pytest.mark.parametrize("dtype", EPS)
def test_captured_equals_launched_one_by_one(integrator, dtype):
    results = []
    for capture in (True, False):
        sim = simulate(rope_model(7, dtype), integrator, substeps=2, capture=capture, on_failure="continue")
        for frame in range(6):
            if frame == 2:
                sim.grab(3)
                sim.move_to((0.45, 0.02, 0.03))
            if frame == 4:
                sim.release()
            sim.step()
        results.append(state(sim))
    for a, b in zip(*results, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.allclose(results[0][0], rope_model(7).x)


@every_integrator
@pytest.mark.parametrize("substeps", [2, 8])
def test_float32_stays_close_to_float64(integrator, substeps):
    """0.5 s of a swinging chain: each step rounds positions of 1 m and displacements of 0.1 m or less; the sum of n
    roundings of velocities, carried on for n steps, is n^2 / 2 of the latter. The chain makes some 10 times that."""
    both = [simulate(rope_model(10, dtype), integrator, substeps=substeps) for dtype in EPS]
    for sim, _ in itertools.product(both, range(30)):
        sim.step()
    difference = np.abs(state(both[0])[0] - state(both[1])[0]).max()
    steps = 30 * substeps * len(both[0]._loop.integrator.stages)
    assert 0.0 < difference < 10 * steps * EPS["float32"]
    assert state(both[1])[0][-1, 1] < -0.5, "it has not swung"
