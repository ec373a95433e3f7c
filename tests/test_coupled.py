"""Contacts of particles that both move, inside Newton's method: momentum, Signorini's and Coulomb's law, statics."""

import numpy as np
import pytest
from models import state
from solving import EPS, both_precisions, converged, run

import pbd_warp as pbd
from pbd_warp.step.methods import coupling

G = 9.81
RADIUS = 0.03


def ropes_across(friction, fixed=True, dtype="float64", **kwargs):
    """One rope, held by both ends or free, and another that falls onto it."""
    builder = pbd.ModelBuilder(**kwargs)
    t = np.linspace(-1.0, 1.0, 21)
    held = (0, 20) if fixed else ()
    low = builder.add_rope(np.c_[0.49 * t, 0.05 * t * t, 0 * t], mass=1.0, pinned=held, radius=RADIUS)
    high = builder.add_rope(
        np.c_[0.003 + 0.02 * t * t, 0.015 + 0.02 * t * t, 0.49 * t], mass=0.5, pinned=(), radius=RADIUS
    )
    builder.enable_contacts(friction=friction)
    return builder.finalize(dtype=dtype), low, high


def pile(friction, dtype="float64", discs=12):
    """Discs of many sizes falling into a corner of three planes."""
    rng = np.random.default_rng(3)
    builder = pbd.ModelBuilder()
    k = np.arange(discs)
    x = np.c_[-0.25 + 0.15 * (k % 3), 0.08 + 0.12 * (k // 3), 0 * k] + 0.01 * rng.normal(size=(discs, 3)) * [1, 1, 0]
    builder.add_particles(x, mass=rng.uniform(0.5, 2.0, discs), radius=rng.uniform(0.03, 0.05, discs))
    for point, normal in ((0, 0, 0), (0, 1, 0)), ((-0.32, 0, 0), (1, 0, 0)), ((0.12, 0, 0), (-1, 0, 0)):
        builder.add_plane(point, normal, friction=friction)
    builder.enable_contacts(friction=friction)
    return builder.finalize(dtype=dtype)


def pair_forces(sim):
    """Pairs that touched in the last step, and the force on the first [N]."""
    c = sim._loop.solver._coupling.contacts
    count = int(c.count.numpy()[0])
    force = c.force.numpy()[:count] * sim._loop.solver._newtons()
    some = np.linalg.norm(force, axis=1) > 0.0
    return c.member.numpy()[:count][some, :2], force[some]


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("case", ["ropes", "pile"])
def test_every_step_obeys_momentum_signorini_and_coulomb(case, friction):
    model = ropes_across(friction)[0] if case == "ropes" else pile(friction)
    h = 1 / 240
    sim = pbd.Simulation(model, dt=h, method=pbd.Direct())
    edge = model.distance.edge
    seen = {"sticks": 0, "slides": 0}
    for _ in range(160):
        x, v = state(sim)
        sim.step()
        converged(sim)
        u = sim._context.u.numpy()
        p = x + u
        momentum = (u - h * v) * np.where(model.w > 0.0, 1 / np.maximum(model.w, 1e-300), 0.0)[:, None] / (h * h)
        momentum -= np.where(model.w > 0.0, 1 / np.maximum(model.w, 1e-300), 0.0)[:, None] * model.gravity
        momentum -= sim.forces.contact
        scale = 1.0 + np.abs(sim.forces.contact).max()
        if len(edge):
            d = p[edge[:, 0]] - p[edge[:, 1]]
            length = np.linalg.norm(d, axis=1)
            assert np.abs(length / model.distance.rest_length - 1).max() < 1e-11
            pull = d / length[:, None] * sim.tension[:, None]
            np.add.at(momentum, edge[:, 0], pull)
            np.add.at(momentum, edge[:, 1], -pull)
            scale += np.abs(sim.tension).max()
        assert np.abs(momentum[model.w > 0.0]).max() < 1e-9 * scale

        assert pbd.measure(sim).overlap < 1e-11
        for (i, j), force in zip(*pair_forces(sim), strict=True):
            away = p[i] - p[j]
            distance = np.linalg.norm(away)
            n = away / distance
            assert abs(distance - model.radius[i] - model.radius[j]) < 1e-10
            push = force @ n
            grip = force - push * n
            slip = (u[i] - u[j]) - ((u[i] - u[j]) @ n) * n
            assert push > 0.0
            assert np.linalg.norm(grip) <= friction * push * (1 + 1e-9) + 1e-11
            if np.linalg.norm(slip) > 1e-8:
                seen["slides"] += 1
                expected = -friction * push * slip / np.linalg.norm(slip)
                np.testing.assert_allclose(grip, expected, atol=1e-5 * (push + 1e-2))
            else:
                seen["sticks"] += 1
    assert seen["slides"] > (20 if friction < 0.8 else 1)
    assert friction == 0.0 or seen["sticks"] > 50


@both_precisions
def test_two_free_ropes_keep_the_momentum_of_both(dtype):
    model, low, high = ropes_across(0.4, False, dtype, gravity=(0, 0, 0))
    sim = pbd.Simulation(model, substeps=4, method=pbd.Direct())
    v = np.zeros((model.particle_count, 3))
    v[high] = [0.3, -1.0, 0.1]
    sim.state.v.assign(v.astype(model.dtype))
    mass = 1.0 / model.w[:, None]
    before = (mass * v).sum(axis=0)
    for _ in range(20):
        sim.step()
        converged(sim)
    v = state(sim)[1]
    np.testing.assert_allclose((mass * v).sum(axis=0), before, atol={"float64": 1e-12, "float32": 1e-5}[dtype])
    assert (mass * v)[low].sum(axis=0)[1] < -0.1, "nothing was handed over"


@both_precisions
@pytest.mark.parametrize("mass", ["equal", "light below", "heavy below"])
def test_a_stack_carries_its_weight(mass, dtype):
    """Contact k carries all that lies above it, and nothing moves."""
    n, r = 8, 0.1
    masses = {"equal": np.ones(n), "light below": np.geomspace(1, 1e6, n), "heavy below": np.geomspace(1e6, 1, n)}[mass]
    builder = pbd.ModelBuilder()
    builder.add_particles(np.c_[np.zeros(n), r * (2 * np.arange(n) + 1), np.zeros(n)], mass=masses, radius=r)
    builder.add_plane((0, 0, 0), (0, 1, 0), friction=0.5)
    builder.enable_contacts(friction=0.5)
    model = builder.finalize(dtype=dtype)
    sim = run(model, 10, converged, substeps=4, method=pbd.Direct())
    pairs, force = pair_forces(sim)
    np.testing.assert_array_equal(pairs, np.c_[np.arange(n - 1), np.arange(1, n)])
    above = G * np.cumsum(masses[::-1])[::-1]
    rounding = EPS[dtype] * model.x.max()  # of a position: it is taken back within a step h
    h = sim.dt / sim.substeps
    lifted = n * rounding / h**2 * masses.sum()  # if each contact is off by as much
    # A gap is tolerated over what its force would move the lighter side, which the heavier one takes for a push.
    rtol = 2e-12 * masses.max() / masses.min() + 1e-7
    np.testing.assert_allclose(force[:, 1], -above[1:], rtol=rtol, atol=lifted)
    np.testing.assert_allclose(sim.forces.contact[:, 1], G * masses, rtol=rtol, atol=2 * lifted)
    x, v = state(sim)
    np.testing.assert_allclose(x, model.x, atol=max(1e-11, 10 * rounding))
    assert np.abs(v).max() < max(1e-9, n * rounding / h, rtol * G * h)


@both_precisions
@pytest.mark.parametrize("friction", [0.1, 0.5])
@pytest.mark.parametrize("part", [0.97, 1.03])
def test_a_ball_on_a_ball_holds_up_to_the_angle_of_friction(part, friction, dtype):
    """The lower one is free, but rods hold it from three sides: contact and rods are solved together."""
    angle = np.arctan(part * friction)
    n = np.array([np.sin(angle), np.cos(angle), 0.0])
    builder = pbd.ModelBuilder()
    builder.add_particles([[0, 0, 0], 0.2 * n], mass=[1.0, 2.0], radius=0.1)
    builder.add_particles([[1.0, 0.2, 0], [-1, 0.3, 0.5], [-0.2, 0.1, -1], [0.1, -1, 0.1]], mass=0.0)
    builder.add_distances([(0, 2), (0, 3), (0, 4), (0, 5)])
    builder.enable_contacts(friction=friction)
    sim = run(builder.finalize(dtype=dtype), 10, converged, substeps=8, method=pbd.Direct())
    u = state(sim)[0][1] - 0.2 * n
    if part < 1.0:
        assert np.linalg.norm(u) < {"float64": 1e-9, "float32": 1e-5}[dtype]
    else:
        fall = G * (np.sin(angle) - friction * np.cos(angle)) * sim.time**2 / 2
        assert np.linalg.norm(u) == pytest.approx(fall, rel=0.2)


def test_a_crowd_that_collides_in_the_air_keeps_its_momentum(rng):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    x = rng.uniform(-0.3, 0.3, (30, 3))
    builder.add_particles(x, -3.0 * x, rng.uniform(0.1, 10.0, 30), rng.uniform(0.03, 0.06, 30))
    builder.enable_contacts(friction=0.4)
    model = builder.finalize(dtype="float64")
    before = (-3.0 * x / model.w[:, None]).sum(axis=0)
    sim = run(model, 10, converged, substeps=4, method=pbd.Direct())
    np.testing.assert_allclose((state(sim)[1] / model.w[:, None]).sum(axis=0), before, atol=1e-11)
    assert pbd.measure(sim).overlap < 1e-11


def test_more_contacts_than_are_coupled_are_an_error(monkeypatch):
    monkeypatch.setattr(coupling, "ROOM", 8)
    sim = pbd.Simulation(ropes_across(0.3)[0], substeps=4, method=pbd.Direct())
    with pytest.raises(pbd.SimulationFailed, match=r"contacts touch \d+ particles of one connected piece"):
        sim.step(frames=20)
