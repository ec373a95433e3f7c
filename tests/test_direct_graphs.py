"""Direct on any graph: exact where there is a solution, spread where there is none, and never silent about failure."""

import numpy as np
import pytest
from models import state
from solving import EPS, converged, run
from test_direct import SCHEMES, balance

import pbd_warp as pbd
from pbd_warp.step.methods.schedule import minimum_degree, schedule

both_schemes = pytest.mark.parametrize("integrator", SCHEMES)
both_precisions = pytest.mark.parametrize("dtype", EPS)


def build(x, edges, pinned=(0,), mass=1.0, dtype="float64", rest_length=None, gravity=(0, -9.81, 0), v=None):
    builder = pbd.ModelBuilder(gravity=gravity)
    masses = np.array(np.broadcast_to(mass, len(x)), float)
    masses[list(pinned)] = 0.0
    builder.add_particles(x, np.zeros_like(x) if v is None else v, mass=masses)
    builder.add_distances(edges, rest_length)
    return builder.finalize(dtype=dtype)


def net(k):
    """A square of 1 m in the plane y = 0, k x k particles."""
    a, b = np.meshgrid(np.arange(k), np.arange(k), indexing="ij")
    q = np.arange(k * k).reshape(k, k)
    edges = np.r_[np.c_[q[:-1].ravel(), q[1:].ravel()], np.c_[q[:, :-1].ravel(), q[:, 1:].ravel()]]
    return np.stack([a, 0 * a, b], -1).reshape(-1, 3) / (k - 1.0), edges


def loop(n):
    angle = np.arange(n) * 2 * np.pi / n
    return np.c_[np.cos(angle), 0 * angle, np.sin(angle)] / 3, np.c_[np.arange(n), (np.arange(n) + 1) % n]


def tree(n, rng):
    x = np.zeros((n, 3))
    for c in range(1, n):
        x[c] = x[(c - 1) // 2] + 0.2 * rng.normal(size=3)
    return x, np.c_[(np.arange(1, n) - 1) // 2, np.arange(1, n)]


def graph(case, rng):
    if case == "loop":
        return loop(24)
    if case == "tree":
        return tree(31, rng)
    if case == "net":
        return net(5)
    if case == "star":
        return np.r_[[[0.0, 0, 0]], rng.normal(size=(7, 3))], np.c_[np.zeros(7, int), np.arange(1, 8)]
    if case == "twice":
        x = np.cumsum(rng.normal(size=(8, 3)), axis=0)
        path = np.c_[np.arange(7), np.arange(1, 8)]
        return x, np.r_[path, path[[2]], path[[4, 4]]]
    # More distances than unknowns: every pair of 9 particles.
    return rng.normal(size=(9, 3)), np.array([(i, j) for i in range(9) for j in range(i)])


GRAPHS = ("loop", "tree", "net", "star", "twice", "every pair")


@both_schemes
@pytest.mark.parametrize("case", GRAPHS)
def test_a_step_balances_momentum_and_lengths_to_round_off(case, integrator, rng):
    x, edges = graph(case, rng)
    v = 0.3 * rng.normal(size=x.shape)
    v[0] = 0.0
    model = build(x, edges, mass=rng.uniform(0.5, 2.0, len(x)), v=v)
    h = 1 / 240
    sim = pbd.Simulation(model, dt=h, method=pbd.Direct(), integrator=integrator)
    part = 0.5 if SCHEMES[integrator] else 1.0
    for _ in range(4):
        x, v = state(sim)
        sim.step()
        converged(sim)
        base = np.where(model.w[:, None] > 0.0, h * v + part * h * h * model.gravity, 0.0)
        scale = part * h * h
        u = sim._context.u.numpy()
        lam = -scale * sim._loop.solver.tension()
        momentum, stretch = balance(model, x, base, scale, SCHEMES[integrator], u, lam)
        assert np.abs(stretch).max() < 1e-12 * model.distance.rest_length.min()
        assert np.abs(momentum).max() < 1e-13 * max(1.0, (model.w.max() * np.abs(lam)).max())
    assert np.abs(u - base).max() > 1e-6, "nothing was to be done"


@pytest.mark.parametrize("case", ["loop", "tree", "net"])
def test_midpoint_keeps_energy_on_every_graph(case, rng):
    model = build(*graph(case, rng), mass=0.05)
    sim = pbd.Simulation(model, substeps=4, method=pbd.Direct(), integrator="midpoint")
    energy = pbd.measure(sim).energy
    for _ in range(30):
        sim.step()
        converged(sim)
    assert abs(pbd.measure(sim).energy - energy) < 1e-12  # of several joules
    assert np.sum(state(sim)[1] ** 2) > 0.1, "nothing moves"


def test_fifty_links_take_at_most_2_6_iterations_a_stage():
    t = np.linspace(0.0, 1.0, 51)
    model = build(np.stack([t, 0 * t, 0 * t], 1), np.c_[np.arange(50), np.arange(1, 51)], mass=0.02)
    used = []
    run(
        model,
        60,
        lambda sim: (converged(sim), used.append(sim.iterations_used / 40)),
        substeps=8,
        method=pbd.Direct(),
        integrator="midpoint4",
    )
    assert np.mean(used) <= 2.6


# Redundant, taut, contradictory.


@both_precisions
@pytest.mark.parametrize("case", ["straight rope", "net by two corners", "net by four corners"])
def test_what_is_held_taut_stretches_by_less_than_a_millionth(case, dtype):
    if case == "straight rope":
        t = np.linspace(0.0, 1.0, 51)
        x, edges, pinned = np.stack([t, 0 * t, 0 * t], 1), np.c_[np.arange(50), np.arange(1, 51)], (0, 50)
    else:
        x, edges = net(12)
        pinned = (0, 132) if "two" in case else (0, 11, 132, 143)
    sim = run(build(x, edges, pinned, 1 / len(x), dtype), 8, converged, substeps=4, method=pbd.Direct())
    rounding = 4 * EPS[dtype] / sim.model.distance.rest_length.min()
    assert pbd.measure(sim).max_stretch < 1e-6 + rounding


@both_precisions
def test_a_rope_of_1000_links_held_6_percent_too_far_is_stretched_evenly(dtype):
    t = np.linspace(0.0, 1.0, 1001)
    model = build(
        np.stack([1.06 * t, 0 * t, 0 * t], 1),
        np.c_[np.arange(1000), np.arange(1, 1001)],
        (0, 1000),
        1e-3,
        dtype,
        rest_length=1e-3,
    )
    sim = run(model, 10, converged, substeps=4, method=pbd.Direct())
    length = np.linalg.norm(np.diff(state(sim)[0], axis=0), axis=1)
    np.testing.assert_allclose(length, 1.06e-3, rtol=1e-6 if dtype == "float64" else 1e-3)
    assert pbd.measure(sim).max_stretch == pytest.approx(0.06, rel=1e-3)


def test_a_loop_that_cannot_close_gives_as_rubber_bands_would():
    """Sides of 1, 1 and 2.1 m: laid flat, each 0.1 / (1 + 1 + 2.1) of its length off, all under one tension."""
    x = np.array([[0.0, 0, 0], [1.02, 0.05, 0], [2.05, 0, 0]])
    edges = [(0, 1), (1, 2), (2, 0)]
    model = build(x, edges, rest_length=[1.0, 1.0, 2.1], gravity=(0, 0, 0))
    sim = run(model, 30, converged, substeps=16, method=pbd.Direct())
    x = state(sim)[0]
    length = np.linalg.norm(x[[0, 1, 2]] - x[[1, 2, 0]], axis=1)
    off = 0.1 / 4.1
    np.testing.assert_allclose(length, [1 + off, 1 + off, 2.1 * (1 - off)], rtol=1e-6)


@pytest.mark.parametrize(("ratio", "mass"), [(1e-7, 1.0), (1.0, 1e6), (1.0, 1e-6)])
@both_precisions
def test_links_and_masses_of_very_different_size(ratio, mass, dtype):
    """Every third link so much shorter, every third particle so much heavier."""
    step = np.where(np.arange(50) % 3 == 1, ratio, 1.0)
    x = np.zeros((51, 3))
    x[1:, 0] = np.cumsum(step) / step.sum()
    rest = step / step.sum()
    masses = np.where(np.arange(51) % 3 == 0, mass, 1.0)
    model = build(x, np.c_[np.arange(50), np.arange(1, 51)], mass=masses, dtype=dtype, rest_length=rest)
    # In float32 a link of 3e-9 m is below the rounding of positions: that is its stretch.
    sim = run(model, 10, converged, method=pbd.Direct(), substeps=4, limits=pbd.Limits(stretch=1e9))
    x, _ = state(sim)
    length = np.linalg.norm(np.diff(x, axis=0), axis=1)
    np.testing.assert_allclose(length, rest, atol=4 * EPS[dtype])
    assert x[-1, 1] < -0.1, "it has not fallen"


# Points, lengths of nothing.


def test_two_points_at_one_particle_share_it():
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_rope([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], pinned=())
    builder.add_point(0, (0.0, 0.2, 0.0), compliance=1e-3)
    builder.add_point(0, (0.0, 0.0, 0.0), compliance=3e-3)
    sim = run(builder.finalize(dtype="float64"), 400, converged, method=pbd.Direct())
    np.testing.assert_allclose(state(sim)[0][0, 1], 0.15, atol=1e-3)


def test_a_rigid_point_holds_with_the_weight_that_hangs_on_it():
    builder = pbd.ModelBuilder()
    builder.add_rope(np.c_[np.zeros(4), -np.arange(4.0), np.zeros(4)], mass=2.0, pinned=())
    builder.add_point(0, (0.0, 0.0, 0.0))
    builder.add_point(0, (0.0, 0.0, 0.0))  # and once more
    sim = run(builder.finalize(dtype="float64"), 3, converged, method=pbd.Direct())
    force = sim._loop.solver.point_reaction()
    np.testing.assert_allclose(force.sum(axis=0), [0.0, 2.0 * 9.81, 0.0], atol=1e-9)
    np.testing.assert_allclose(sim._loop.solver.tension(), 9.81 * 2.0 / 6 * np.array([5, 3, 1]), rtol=1e-9)


@both_schemes
def test_a_distance_of_nothing_joins_two_particles(integrator):
    builder = pbd.ModelBuilder()
    builder.add_rope([[0.0, 0, 0], [1, 0, 0]], pinned=(0,))
    builder.add_rope([[1.0, 0, 0], [2, 0, 0]], pinned=())
    builder.add_distances([(1, 2)], rest_length=0.0)
    sim = run(builder.finalize(dtype="float64"), 30, converged, substeps=4, method=pbd.Direct(), integrator=integrator)
    x, _ = state(sim)
    assert np.linalg.norm(x[1] - x[2]) < 1e-13
    assert x[3, 1] < -0.5, "it has not fallen"


# Failure.


def test_too_few_iterations_are_counted(rng):
    model = build(*net(6), mass=0.1)
    sim = run(model, 2, substeps=1, method=pbd.Direct(1), on_failure="continue")
    assert sim.unconverged == 1


# The schedule.


def test_paths_and_trees_fill_nothing(rng):
    for edges, n in ((np.c_[np.arange(99), np.arange(1, 100)], 100), (tree(127, rng)[1], 127)):
        s = schedule(edges, np.ones(n, bool), np.zeros(n, bool))
        assert len(s.row) == n - 1
        assert s.filled.sum() == 0


def test_columns_are_those_of_an_elimination_of_the_full_matrix(rng):
    """Against Gaussian elimination of a dense pattern in the same order."""
    x, edges = net(6)
    n = len(x)
    s = schedule(edges, np.ones(n, bool), np.zeros(n, bool))
    there = np.eye(n, dtype=bool)
    there[s.tile[edges[:, 0]], s.tile[edges[:, 1]]] = there[s.tile[edges[:, 1]], s.tile[edges[:, 0]]] = True
    for t in range(n):
        rows = t + 1 + np.flatnonzero(there[t + 1 :, t])
        there[np.ix_(rows, rows)] = True
        np.testing.assert_array_equal(s.row[s.column_first[t] : s.column_first[t + 1]], rows)
    order, _ = minimum_degree(n, edges, np.arange(n))
    assert sorted(order) == list(range(n))
