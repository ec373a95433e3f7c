"""Contacts and friction inside Newton's method: Coulomb's law, ropes that hold and slide where they should."""

import numpy as np
import pytest
from models import state
from solving import EPS, converged, run

import pbd_warp as pbd
from pbd_warp.step.methods.direct import ACCEPTED_CONTACT

both_precisions = pytest.mark.parametrize("dtype", EPS)

# The law itself, from positions and forces alone.

BALL = 0.3
SLOPE = np.array([0.1, 1.0, 0.0]) / np.linalg.norm([0.1, 1.0, 0.0])
RADIUS = 0.02


def rope_over_ball_and_slope(friction):
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([-0.8, 0.4, 0.05], [0.8, 0.4, 0.1], 41), pinned=(), radius=RADIUS)
    builder.add_sphere((0, 0, 0), BALL, friction=friction)
    builder.add_plane((0, -0.3, 0), SLOPE, friction=friction)
    return builder.finalize(dtype="float64")


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.8])
def test_every_step_obeys_momentum_signorini_and_coulomb(friction):
    model = rope_over_ball_and_slope(friction)
    h = 1 / 240
    sim = pbd.Simulation(model, dt=h, method=pbd.Direct())
    edge, rest = model.distance.edge, model.distance.rest_length
    balanced = []
    seen = {"sticks": 0, "slides": 0}
    for _ in range(200):
        x, v = state(sim)
        sim.step()
        converged(sim)
        u = sim._context.u.numpy()
        force = sim._loop.solver.contact_force()
        d = (x + u)[edge[:, 0]] - (x + u)[edge[:, 1]]
        length = np.linalg.norm(d, axis=1)
        assert np.abs(length / rest - 1).max() < 1e-11

        momentum = (u - h * v - h * h * model.gravity) / (model.w[:, None] * h * h) - force
        pull = d / length[:, None] * sim._loop.solver.tension()[:, None]
        np.add.at(momentum, edge[:, 0], pull)
        np.add.at(momentum, edge[:, 1], -pull)
        # What counts as converged, of a link's length and of what forces move.
        accepted = ACCEPTED_CONTACT["float64"]
        size = rest.mean() / (model.w.max() * h * h) + np.abs(pull).max()
        assert np.abs(momentum).max() < accepted * size
        balanced.append(np.abs(momentum).max() / size)

        p = x + u
        ball = p / np.linalg.norm(p, axis=1)[:, None]
        gaps = np.stack([np.linalg.norm(p, axis=1) - BALL - RADIUS, (p - [0, -0.3, 0]) @ SLOPE - RADIUS], axis=1)
        assert gaps.min() > -1e-11
        touched = np.flatnonzero(np.linalg.norm(force, axis=1) > 0.0)
        for i in touched:
            which = int(np.argmin(np.abs(gaps[i])))
            if np.sort(np.abs(gaps[i]))[1] < 1e-6:
                continue  # touches both: their forces are summed
            normal = ball[i] if which == 0 else SLOPE
            assert abs(gaps[i, which]) < 1e-10
            push = force[i] @ normal
            grip = force[i] - push * normal
            slip = u[i] - (u[i] @ normal) * normal
            size, held = np.linalg.norm(slip), np.linalg.norm(grip)
            assert push > 0.0
            assert held <= friction * push * (1 + 1e-9) + 1e-12
            if size > 1e-8:
                seen["slides"] += 1
                np.testing.assert_allclose(grip, -friction * push * slip / size, atol=1e-6 * (push + 1e-3))
            else:
                seen["sticks"] += 1
    assert np.median(balanced) < 1e-13
    assert seen["slides"] > 50
    assert friction == 0.0 or seen["sticks"] > 50


# Capstan.


def capstan(friction, load, dtype, links=120, masses=0.01):
    """A rope over a ball, 1 kg at one end and `load` times what the polygon's own equation allows at the other."""
    side = 0.6
    total = np.pi * BALL + 2 * side
    along = np.linspace(0.0, total, links + 1)
    angle = np.pi - (along - side) / BALL
    x = np.stack([BALL * np.cos(angle), BALL * np.sin(angle), 0 * angle], axis=1)
    x[along < side] = [[-BALL, s - side, 0] for s in along[along < side]]
    x[along > total - side] = [[BALL, total - side - s, 0] for s in along[along > total - side]]
    d = np.diff(x, axis=0)
    d /= np.linalg.norm(d, axis=1)[:, None]
    half_turn = np.arccos(np.clip(np.sum(d[1:] * d[:-1], axis=1), -1, 1)) / 2
    touches = np.abs(np.linalg.norm(x[1:-1], axis=1) - BALL) < 1e-9
    tangent = friction * np.tan(half_turn[touches])
    limit = np.prod((1 + tangent) / (1 - tangent))
    mass = np.full(links + 1, masses / (links + 1))
    mass[0] += 1.0
    mass[-1] += load * limit
    builder = pbd.ModelBuilder()
    builder.add_particles(x, mass=mass)
    builder.add_distances(np.c_[np.arange(links), np.arange(1, links + 1)])
    builder.add_sphere((0, 0, 0), BALL, friction=friction)
    return builder.finalize(dtype=dtype), limit


@both_precisions
@pytest.mark.parametrize(("friction", "masses"), [(0.1, 0.01), (0.3, 0.01), (0.8, 0.01), (0.3, 1e-5)])
def test_a_rope_over_a_ball_holds_below_the_limit_of_the_capstan(friction, masses, dtype):
    """The lightest particles weigh 1e-7 of the loads."""
    model, limit = capstan(friction, 0.97, dtype, masses=masses)
    assert limit == pytest.approx(np.exp(friction * np.pi), rel=1e-2)
    sim = run(model, 40, converged, substeps=4, method=pbd.Direct())
    before = state(sim)[0][-1, 1]
    frames = 20
    for _ in range(frames):
        sim.step()
        converged(sim)
    creep = abs(state(sim)[0][-1, 1] - before) / (frames * sim.settings.dt)
    assert creep < {"float64": 1e-6, "float32": 1e-4}[dtype]


@both_precisions
@pytest.mark.parametrize(("friction", "masses"), [(0.1, 0.01), (0.3, 0.01), (0.8, 0.01), (0.3, 1e-5)])
def test_it_slides_above(friction, masses, dtype):
    sim = run(capstan(friction, 1.03, dtype, masses=masses)[0], 30, converged, substeps=4, method=pbd.Direct())
    assert state(sim)[1][-1, 1] < -0.02


def test_the_heavier_end_falls_as_atwood_says_without_friction():
    """(m2 - m1) g / (m1 + m2 + rope), the rope being light."""
    model, _ = capstan(0.0, 1.2, "float64")
    sim = run(model, 12, converged, substeps=16, method=pbd.Direct())
    v = state(sim)[1][-1, 1]
    assert v / sim.time == pytest.approx(-0.2 / 2.21 * 9.81, rel=1e-3)


# Other things to touch.


@both_precisions
@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_a_net_comes_to_lie_on_a_ball(friction, dtype):
    k = 12
    a, b = np.meshgrid(np.arange(k), np.arange(k), indexing="ij")
    q = np.arange(k * k).reshape(k, k)
    edges = np.r_[np.c_[q[:-1].ravel(), q[1:].ravel()], np.c_[q[:, :-1].ravel(), q[:, 1:].ravel()]]
    builder = pbd.ModelBuilder()
    x = np.stack([a, 0 * a, b], -1).reshape(-1, 3) / (k - 1) - [0.5, -0.35, 0.5]
    builder.add_particles(x, mass=1 / k**2, radius=0.01)
    builder.add_distances(edges)
    builder.add_sphere((0, 0, 0.01), BALL, friction=friction)
    worst = []

    unconverged = []

    def check(sim):
        now = pbd.measure(sim)
        worst.append((now.overlap, now.max_stretch))
        unconverged.append(sim.unconverged)

    run(builder.finalize(dtype=dtype), 25, check, substeps=4, method=pbd.Direct(), on_failure="continue")
    assert sum(unconverged) <= 1, "of 100 steps; which one, if any, rounding decides"
    overlap, stretch = np.max(worst, axis=0)
    assert overlap < {"float64": 1e-7, "float32": 1e-6}[dtype]
    assert stretch < {"float64": 1e-7, "float32": 1e-5}[dtype]


def test_a_particle_rests_on_one_that_is_fixed():
    builder = pbd.ModelBuilder()
    builder.add_particles([[0.0, 0, 0], [0.001, 0.2, 0]], mass=[0.0, 1.0], radius=0.1)
    builder.enable_contacts(friction=0.5)
    sim = run(builder.finalize(dtype="float64"), 30, converged, substeps=4, method=pbd.Direct())
    x, v = state(sim)
    assert np.linalg.norm(x[1]) == pytest.approx(0.2, abs=1e-9)
    assert np.abs(v[1]).max() < 1e-6
