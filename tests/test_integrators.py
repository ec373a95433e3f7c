"""How velocity becomes position and back: orders, conserved quantities, frequencies, against references.py."""

import itertools

import numpy as np
import pytest
from models import rope_model, state
from scipy.special import eval_laguerre

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.step.integrators import INTEGRATORS

EPS = {"float32": float(np.finfo(np.float32).eps), "float64": float(np.finfo(np.float64).eps)}
G = 9.81
every_integrator = pytest.mark.parametrize("integrator", INTEGRATORS)
higher_order = pytest.mark.parametrize("integrator", ["bdf2", "midpoint", "midpoint4"])
energy_keeping = pytest.mark.parametrize("integrator", ["midpoint", "midpoint4"])


def chain_model(x, masses, dtype="float64", gravity=(0, -G, 0), velocity=(0, 0, 0), rest_length=None, **soft):
    """Particles joined in a row; mass 0 is fixed."""
    builder = pbd.ModelBuilder(gravity=gravity)
    builder.add_particles(x, velocity, masses)
    builder.add_distances([(k, k + 1) for k in range(len(x) - 1)], rest_length, **soft)
    return builder.finalize(dtype=dtype)


def simulate(model, integrator, **settings):
    return pbd.Simulation(model, method=pbd.Direct(), integrator=integrator, **settings)


def level(links, length=1.0):
    """Positions of a chain that starts level."""
    return np.linspace([0.0, 0, 0], [length, 0, 0], links + 1)


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


# The pendulum's period and amplitude.


def crossings(times, y, rate):
    """Times at which y is 0, by the cubic through values and rates of the samples around."""
    found = []
    for k in np.flatnonzero(y[:-1] * y[1:] < 0):
        h = times[k + 1] - times[k]
        d0, d1 = h * rate[k], h * rate[k + 1]
        jump = y[k + 1] - y[k]
        roots = np.roots([d0 + d1 - 2 * jump, 3 * jump - 2 * d0 - d1, d0, y[k]])
        real = roots[np.abs(roots.imag) < 1e-9].real
        found.append(times[k] + h * real[(real >= 0) & (real <= 1)][0])
    return np.array(found)


def record(sim, frames, particle, axis=0):
    """Times, and one coordinate of a particle and its rate, at all frame ends."""
    rows = [(0.0, sim.model.x[particle, axis], sim.model.v[particle, axis])]
    for frame in range(1, frames + 1):
        sim.step()
        x, v = state(sim)
        rows.append((frame * sim.dt, x[particle, axis], v[particle, axis]))
    return np.array(rows).T


@pytest.mark.parametrize(
    ("integrator", "period_slope", "amplitude_slope"),
    # "bdf2" loses energy by the third power of the step, in its first step ("pbd") by the second; "midpoint" none.
    [("pbd", 1, 1), ("bdf2", 2, 2.5), ("midpoint", 2, None), ("midpoint4", 4, None)],
)
def test_period_and_amplitude_of_the_pendulum(integrator, period_slope, amplitude_slope):
    theta0, length = 2.0, 1.0
    exact = references.pendulum_period(theta0, length)
    x0 = [(0, 0, 0), (length * np.sin(theta0), -length * np.cos(theta0), 0)]
    model = chain_model(x0, [0.0, 1.0])
    sizes = {"pbd": (4, 8, 16, 32), "midpoint4": (1, 2, 3, 4)}.get(integrator, (2, 4, 8, 16))
    period, amplitude = [], []
    for substeps in sizes:
        sim = simulate(model, integrator, substeps=substeps)
        times, y, rate = record(sim, int(60 * exact) + 1, particle=1)
        half = np.diff(crossings(times, y, rate))[0]
        # The samples' cubic is wrong by h^4: with 60 samples a second by less than the schemes are.
        period.append(abs(2 * half - exact))
        amplitude.append(abs(np.arccos(-pbd.measure(sim).energy / (G * length)) - theta0))
    step = np.log(1.0 / np.array(sizes))
    if integrator == "midpoint4":
        assert period[0] < 1e-3
        assert period[-1] < 1e-6
    else:
        assert np.polyfit(step, np.log(period), 1)[0] == pytest.approx(period_slope, abs=0.15)
    if amplitude_slope is None:
        assert max(amplitude) < 1e-12
    else:
        assert np.polyfit(step, np.log(amplitude), 1)[0] == pytest.approx(
            amplitude_slope, abs=0.6 if integrator == "bdf2" else 0.15
        )


# What is conserved.


def dumbbell(omega):
    x = np.array([(0.5, 0, 0), (-0.5, 0, 0)])
    return chain_model(x, [1.0, 1.0], gravity=(0, 0, 0), velocity=np.cross([0, 0, omega], x))


def turned(sim, frames):
    """Angle by which the dumbbell turns in each frame."""
    angles = [0.0]
    for _ in range(frames):
        sim.step()
        d = state(sim)[0]
        angles.append(np.arctan2(*(d[0] - d[1])[1::-1]))
    return np.diff(np.unwrap(angles))


@pytest.mark.parametrize("omega", [1.0, 2 * np.pi, 40.0])
def test_pbd_slows_a_dumbbell_by_the_exact_recursion(omega):
    """From tangential velocities the first step turns atan(omega h); 64 % of one turn a second is gone in 5 s."""
    h, frames = 1 / 60, 300
    found = turned(simulate(dumbbell(omega), "pbd"), frames) / h
    exact = references.dumbbell_spin(np.arctan(omega * h) / h, h, frames - 1)
    np.testing.assert_allclose(found, exact, rtol=1e-11)  # 300 roundings of a position over a step of some 0.01 rad
    if omega == 2 * np.pi:
        assert found[-1] == pytest.approx(0.36 * omega, rel=0.02)


@pytest.mark.parametrize("omega", [1.0, 2 * np.pi, 40.0])
def test_midpoint_keeps_the_spin_of_a_dumbbell(omega):
    """Angle a step 2 atan(omega h / 2), and the velocities that of the spin."""
    h, frames = 1 / 60, 300
    sim = simulate(dumbbell(omega), "midpoint")
    found = turned(sim, frames)
    np.testing.assert_allclose(found, 2 * np.arctan(omega * h / 2), rtol=1e-12, atol=1e-14)
    assert pbd.measure(sim).angular_momentum[2] / 0.5 == pytest.approx(omega, rel=1e-12)


def spinning_chain(rng, n=10, compliance=0.0, gravity=(0, 0, 0)):
    x = 0.1 * np.cumsum(rng.normal(size=(n, 3)), axis=0)
    v = np.cross([1.0, -2.0, 3.0], x) + np.array([0.3, 0.2, 0.1])
    return chain_model(x, rng.uniform(0.5, 2.0, n), velocity=v, compliance=compliance, gravity=gravity)


@energy_keeping
@pytest.mark.parametrize("compliance", [0.0, 1e-3])
def test_what_is_conserved_on_a_free_chain(integrator, compliance, rng):
    """Energy, momentum, angular momentum, to round-off; while "pbd" and "bdf2" lose of the two that it does not have
    to keep."""
    model = spinning_chain(rng, compliance=compliance)
    sim = simulate(model, integrator)
    first = pbd.measure(sim)
    for _ in range(60):
        sim.step()
    last = pbd.measure(sim)
    assert np.abs(state(sim)[0] - model.x).max() > 0.5, "it has not moved"
    # 60 steps (5 times as many) of values of some 10 kg m^2/s and J.
    np.testing.assert_allclose(last.momentum, first.momentum, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(last.angular_momentum, first.angular_momentum, rtol=1e-11, atol=1e-11)
    assert last.energy == pytest.approx(first.energy, rel=1e-11)
    for other in ("pbd", "bdf2"):
        lossy = simulate(model, other)
        for _ in range(60):
            lossy.step()
        assert pbd.measure(lossy).energy < first.energy * (1 - 1e-4)


@energy_keeping
def test_a_compliant_chain_in_gravity_keeps_its_energy(integrator):
    model = chain_model(level(9), np.r_[0.0, np.full(9, 0.1)], compliance=1e-3)
    sim = simulate(model, integrator, substeps=4)
    elastic = 0.0
    for _ in range(30):
        sim.step()
        elastic = max(elastic, pbd.measure(sim).max_stretch)
        assert pbd.measure(sim).energy == pytest.approx(0.0, abs=1e-11)  # it starts with 0, exchanges some 4 J
    assert elastic > 0.01, "no link was stretched"


# Small oscillations.


def frequency(sim, frames, particle, axis):
    """Angular frequency, from all the times at which a coordinate is 0."""
    times = crossings(*record(sim, frames, particle, axis))
    assert len(times) >= 3
    return np.pi * (len(times) - 1) / (times[-1] - times[0])


@pytest.mark.parametrize("integrator", ["bdf2", "midpoint", "midpoint4"])
@pytest.mark.parametrize("mode", [0, 1])
def test_small_oscillations_of_a_hanging_chain(integrator, mode):
    """In one mode: deflections are Laguerre polynomials. The amplitude's error is of its square, 1e-6 and less."""
    links, a = 10, 0.1
    omega = references.chain_frequencies(links, a)[mode]
    z = 1e-4 * eval_laguerre(np.arange(links, -1, -1), omega**2 * a / G)
    y = np.r_[0.0, -np.cumsum(np.sqrt(a**2 - np.diff(z) ** 2))]
    model = chain_model(np.stack([0 * y, y, z], axis=1), np.r_[0.0, np.ones(links)])
    # Of second order the frequency is wrong by (omega h)^2 / 12 ("midpoint") and / 3 ("bdf2"), below 1e-4 here.
    sim = simulate(model, integrator, dt=0.02, substeps=16)
    found = frequency(sim, int(2.5 * 2 * np.pi / omega / 0.02), links, axis=2)
    assert found == pytest.approx(omega, rel=1e-3)


@pytest.mark.parametrize("integrator", ["bdf2", "midpoint", "midpoint4"])
@pytest.mark.parametrize("mode", [0, 2])
def test_small_oscillations_of_a_taut_string(integrator, mode):
    """Compliant links, stretched by T compliance to a. Sideways motion changes their length in second order only, so
    to first order, whatever the compliance, the tension is T."""
    links, a, tension, mass, compliance = 10, 0.1, 20.0, 0.05, 1e-4
    omega = references.string_frequencies(links, a, tension, mass)[mode]
    z = 1e-5 * np.sin(np.pi * (mode + 1) * np.arange(links + 1) / links)
    x = level(links)
    x[:, 2] = z
    masses = np.r_[0.0, np.full(links - 1, mass), 0.0]
    model = chain_model(x, masses, gravity=(0, 0, 0), rest_length=a - tension * compliance, compliance=compliance)
    frame = 2 * np.pi / omega / 40
    sim = simulate(model, integrator, dt=frame, substeps=8)
    assert frequency(sim, 100, particle=1, axis=2) == pytest.approx(omega, rel=1e-3)


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
