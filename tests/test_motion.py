"""What integrators keep and what they lose: periods, spin, momentum, energy, small oscillations."""

import closed_forms
import numpy as np
import pytest
from chains import G, chain_model, energy_keeping, level, simulate
from models import state
from scipy.special import eval_laguerre

import pbd_warp as pbd

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
    exact = closed_forms.pendulum_period(theta0, length)
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
    exact = closed_forms.dumbbell_spin(np.arctan(omega * h) / h, h, frames - 1)
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
    omega = closed_forms.chain_frequencies(links, a)[mode]
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
    omega = closed_forms.string_frequencies(links, a, tension, mass)[mode]
    z = 1e-5 * np.sin(np.pi * (mode + 1) * np.arange(links + 1) / links)
    x = level(links)
    x[:, 2] = z
    masses = np.r_[0.0, np.full(links - 1, mass), 0.0]
    model = chain_model(x, masses, gravity=(0, 0, 0), rest_length=a - tension * compliance, compliance=compliance)
    frame = 2 * np.pi / omega / 40
    sim = simulate(model, integrator, dt=frame, substeps=8)
    assert frequency(sim, 100, particle=1, axis=2) == pytest.approx(omega, rel=1e-3)
