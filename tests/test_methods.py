"""How constraints are projected: tolerances, Gauss-Seidel, Chebyshev, and what each method refuses."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import rope_model, state
from solving import EPS, both_precisions, converged, rope_between, run

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.step.methods.gauss_seidel import colours
from pbd_warp.step.methods.jacobi import PLAIN_ITERATIONS, chebyshev_factors, spectral_radius

# Tolerances, all methods.

SOLVERS = {
    "jacobi": lambda tolerance, iterations=20000: pbd.Jacobi(iterations, tolerance=tolerance),
    "chebyshev": lambda tolerance, iterations=2000: pbd.Jacobi(iterations, chebyshev="auto", tolerance=tolerance),
    "gauss-seidel": lambda tolerance, iterations=20000: pbd.GaussSeidel(iterations, tolerance=tolerance),
    "direct": lambda tolerance, iterations=30: pbd.Direct(iterations, tolerance=tolerance),
}
every_solver = pytest.mark.parametrize("solver", SOLVERS)


@every_solver
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6, 1e-9])
def test_a_step_ends_below_the_tolerance(solver, tolerance):
    method = SOLVERS[solver](tolerance)
    sim = run(rope_model(9), 3, converged, method=method)
    assert pbd.measure(sim).residual < tolerance
    assert 0 < sim.iterations_used < method.iterations


@every_solver
def test_a_tighter_tolerance_takes_more_iterations(solver):
    """Newton squares the error: from one tolerance to the next there may be nothing to do."""
    used = [run(rope_model(9), 1, method=SOLVERS[solver](t)).iterations_used for t in (1e-3, 1e-5, 1e-9, 1e-12)]
    assert used == sorted(used)
    assert len(set(used)) >= (2 if solver == "direct" else 3)


@every_solver
def test_iterations_used_are_of_one_frame(solver):
    """Not of all frames so far; and of all its substeps."""
    sim = run(rope_model(9, gravity=(0, 0, 0)), 3, method=SOLVERS[solver](1e-9), substeps=5)
    assert sim.iterations_used == 5  # at rest the first iteration already finds nothing to do


@every_solver
@pytest.mark.parametrize("capture", [True, False])
def test_a_cap_too_low_is_reported(solver, capture):
    settings = {"method": SOLVERS[solver](1e-12, 2), "substeps": 3, "capture": capture, "on_failure": "continue"}
    sim = run(rope_model(33), 2, **settings)
    assert sim.unconverged == 3
    assert sim.iterations_used == 6


@every_solver
@both_precisions
def test_captured_equals_launched_with_a_tolerance(solver, dtype):
    method = SOLVERS[solver](1e-4)
    one, other = (run(rope_model(9, dtype), 4, method=method, substeps=2, capture=c) for c in (True, False))
    for a, b in zip(state(one), state(other), strict=True):
        np.testing.assert_array_equal(a, b)
    assert one.iterations_used == other.iterations_used
    assert not np.allclose(state(one)[0], one.model.x)


@every_solver
@pytest.mark.parametrize("tolerance", [None, 1e-4])
def test_only_a_tolerance_makes_a_loop(solver, tolerance):
    """Direct's loop is inside its kernel."""
    passes = pbd.Simulation(rope_model(), method=SOLVERS[solver](tolerance, 20)).passes
    assert ("while" in passes) == (tolerance is not None and solver != "direct")


@pytest.mark.parametrize("method", [pbd.Jacobi(7), pbd.GaussSeidel(7)])
def test_without_a_tolerance_all_iterations_are_made(method):
    sim = run(rope_model(), 2, method=method, substeps=3)
    assert (sim.iterations_used, sim.unconverged) == (21, None)


# Gauss-Seidel.


@st.composite
def graphs(draw):
    """Pairs of some particles, in any number; or a star."""
    n = draw(st.integers(2, 12))
    if draw(st.booleans()):
        return [(0, i) for i in range(1, n)]
    pairs = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(lambda pair: pair[0] != pair[1])
    return draw(st.lists(pairs, max_size=30))


@given(graphs())
def test_no_two_edges_of_a_colour_share_a_particle(edges):
    edge = np.array(edges, dtype=np.int32).reshape(-1, 2)
    groups = colours(edge)
    for group in groups:
        assert len(group) > 0
        assert len(np.unique(edge[group])) == 2 * len(group)
    assert sorted(itertools.chain(*groups)) == list(range(len(edge)))


@pytest.mark.parametrize("links", [2, 3, 10, 101])
def test_a_chain_has_two_colours(links):
    edge = np.stack([np.arange(links), np.arange(1, links + 1)], axis=1)
    assert len(colours(edge)) == 2


def test_gauss_seidel_is_the_sweep_edge_by_edge(rng):
    """In the order of the colours; within one no edge sees another. Points come last."""
    n, h, sweeps = 12, 1 / 60, 7
    builder = pbd.ModelBuilder()
    mass = np.r_[0.0, rng.uniform(0.5, 2.0, n - 1)]
    builder.add_particles(rng.normal(size=(n, 3)), mass=mass)
    edges = [(i, j) for i, j in itertools.combinations(range(n), 2) if rng.random() < 0.3]
    builder.add_distances(edges, rest_length=1.0)
    builder.add_point(n - 1, (0.3, 0.2, 0.1))
    model = builder.finalize(dtype="float64")
    x, w = model.x.copy(), model.w
    order = np.concatenate(colours(model.distance.edge))
    assert len(colours(model.distance.edge)) > 2
    x[w > 0] += h * h * model.gravity
    for _ in range(sweeps):
        for i, j in model.distance.edge[order]:
            d = x[i] - x[j]
            step = (np.linalg.norm(d) - 1.0) / (w[i] + w[j]) * d / np.linalg.norm(d)
            x[i] -= w[i] * step
            x[j] += w[j] * step
        x[n - 1] = (0.3, 0.2, 0.1)
    sim = run(model, 1, method=pbd.GaussSeidel(sweeps))
    # Each of 7 x 20 corrections rounds coordinates of size 1 to 3.
    np.testing.assert_allclose(state(sim)[0], x, atol=7 * 20 * 4 * EPS["float64"])


@pytest.mark.parametrize("n", [5, 20])
def test_gauss_seidel_converges_faster_than_jacobi(n):
    """On a chain some twice as fast: a sweep contracts as two of Jacobi's do."""
    methods = (pbd.GaussSeidel, pbd.Jacobi)
    residual = [pbd.measure(run(rope_model(n), 5, method=m(20))).residual for m in methods]
    assert residual[0] < 0.9 * residual[1]
    used = [run(rope_model(n), 2, converged, method=m(20000, tolerance=1e-10)).iterations_used for m in methods]
    assert used[0] < 0.6 * used[1]


# Chebyshev.


@pytest.mark.parametrize("rho", [0.3, 0.9, 0.999])
def test_chebyshev_factors_are_those_of_wang(rho):
    """omega = 1, then 2/(2 - rho^2), then 4/(4 - rho^2 omega): tends to 2/(1 + sqrt(1 - rho^2))."""
    omega = chebyshev_factors(rho, PLAIN_ITERATIONS + 400)
    np.testing.assert_array_equal(omega[:PLAIN_ITERATIONS], 1.0)
    assert omega[PLAIN_ITERATIONS] == pytest.approx(2 / (2 - rho**2), rel=1e-15)
    later = omega[PLAIN_ITERATIONS:]
    np.testing.assert_allclose(later[1:], 4 / (4 - rho**2 * later[:-1]), rtol=1e-15)
    assert later[-1] == pytest.approx(2 / (1 + np.sqrt(1 - rho**2)), rel=1e-9)
    assert len(chebyshev_factors(rho, 3)) == 3


def jacobi_matrix(model, relaxation, split):
    """1 - relaxation D^-1 A of the distances and points of a model, A = J W J^T, written down edge by edge."""
    rows = []
    for i, j in model.distance.edge:
        row = np.zeros(model.x.shape)
        row[i] = (model.x[i] - model.x[j]) / np.linalg.norm(model.x[i] - model.x[j])
        row[j] = -row[i]
        rows.append(row.ravel())
    for p in model.point.particle:
        rows.extend(np.eye(model.x.size)[3 * p : 3 * p + 3])
    jacobian = np.array(rows)
    count = np.bincount([*model.distance.edge.ravel(), *model.point.particle], minlength=model.particle_count)
    w = np.repeat(model.w, 3)
    share = np.repeat(count, 3) if split else np.ones_like(w)
    denominator = (jacobian**2) @ (share * w)
    return np.eye(len(rows)) - relaxation * (jacobian @ (w[:, None] * jacobian.T)) / denominator[:, None]


@pytest.mark.parametrize("links", [2, 3, 10, 32])
@pytest.mark.parametrize("pinned", [(0,), (0, -1), ()])
def test_the_spectral_radius_of_a_straight_chain(links, pinned):
    model = rope_model(links + 1, pinned=pinned)
    rho = spectral_radius(model, pbd.Jacobi())
    lowest = 1.0 - np.linalg.eigvals(jacobi_matrix(model, 1.0, True)).real.max()
    # Shifted by 1e-12 on purpose; a taut chain between fixed ends has the eigenvalue 0, cut off at 1e-9.
    assert 1.0 - rho == pytest.approx(max(lowest, 1e-9), abs=1e-11)


@pytest.mark.parametrize("links", [3, 10, 32])
def test_the_spectral_radius_of_a_free_straight_chain_is_a_cosine(links):
    """C_k <- (C_{k-1} + 2 C_k + C_{k+1}) / 4: the ends have half of the mass and half of the constraints, so that
    the share of a link in each of its particles is the same all along."""
    rho = spectral_radius(rope_model(links + 1, pinned=()), pbd.Jacobi())
    assert rho == pytest.approx((1 + np.cos(np.pi / links)) / 2, abs=1e-11)


@pytest.mark.parametrize("settings", [{}, {"relaxation": 1.4}, {"averaging": "none", "relaxation": 0.7}])
def test_the_spectral_radius_of_a_bent_chain_with_points(settings, rng):
    builder = pbd.ModelBuilder()
    builder.add_particles(np.cumsum(rng.normal(size=(9, 3)), axis=0), mass=np.r_[0.0, rng.uniform(0.5, 2.0, 8)])
    builder.add_distances([(k, k + 1) for k in range(8)])
    builder.add_point(8)
    model, method = builder.finalize(), pbd.Jacobi(**settings)
    matrix = jacobi_matrix(model, method.relaxation, method.averaging == "mass-splitting")
    assert spectral_radius(model, method) == pytest.approx(np.linalg.eigvals(matrix).real.max(), abs=1e-11)


def test_chebyshev_solves_a_sagging_chain_sooner():
    """32 links between fixed ends: references.md has 0.56 of the residual left without, 0.015 with rho = cos(pi/N)."""
    x = references.catenary(32, 1 / 32, 0.7)
    model = rope_between(x, 1.0, (0, -1))
    residual = {
        rho: pbd.measure(run(model, 1, method=pbd.Jacobi(100, chebyshev=rho))).residual
        for rho in (None, 0.9, np.cos(np.pi / 32), "auto")
    }
    assert residual["auto"] < 0.2 * residual[None]
    assert residual[np.cos(np.pi / 32)] < 0.5 * residual[None]
    assert residual[0.9] < residual[None]


# What is refused.


def star(**kwargs):
    builder = pbd.ModelBuilder()
    builder.add_graph([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], [(0, 1), (0, 2), (0, 3)], **kwargs)
    return builder


def loop():
    builder = pbd.ModelBuilder()
    builder.add_graph([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1), (1, 2), (2, 0)])
    return builder


def double_edge():
    builder = pbd.ModelBuilder()
    builder.add_graph([(0, 0, 0), (1, 0, 0)], [(0, 1), (0, 1)])
    return builder


def rope_with(rest_length=None, points=(), contacts=False, **soft):
    builder = pbd.ModelBuilder()
    builder.add_particles([(0, 0, 0), (1, 0, 0), (2, 0, 0)], radius=0.1)
    builder.add_distances([(0, 1), (1, 2)], rest_length, **soft)
    for particle in points:
        builder.add_point(particle)
    if contacts:
        builder.enable_contacts()
    return builder


@pytest.mark.parametrize(
    ("builder", "method", "message"),
    [
        (rope_with(stiffness=0.5), pbd.Direct(), "soften with compliance instead of a stiffness below 1"),
        (rope_with(contacts=True), pbd.Jacobi(chebyshev=0.9), "chebyshev is for rigid constraints without contacts"),
        (rope_with(compliance=1e-3), pbd.Jacobi(chebyshev="auto"), "chebyshev is for rigid constraints"),
    ],
    ids=["stiffness", "contacts", "compliance"],
)
def test_models_that_a_method_cannot_take(builder, method, message):
    with pytest.raises(pbd.InputError, match=message) as caught:
        pbd.Simulation(builder.finalize(), method=method)
    assert "\n" not in str(caught.value)


METHODS = [pbd.Jacobi, pbd.GaussSeidel, pbd.Direct]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        *[(lambda m=m, t=t: m(tolerance=t), "tolerance must be") for m in METHODS for t in (0.0, -1e-3, np.nan, "x")],
        *[(lambda m=m, k=k: m(k), "iterations must be") for m in METHODS for k in (0, -3, 1.5, True)],
        *[(lambda r=r: pbd.Jacobi(chebyshev=r), "chebyshev must be") for r in (0.0, -0.5, 1.0, 1.5, np.nan, "fast")],
    ],
)
def test_parameters_that_make_no_sense(make, message):
    with pytest.raises(pbd.InputError, match=message) as caught:
        make()
    assert "\n" not in str(caught.value)
