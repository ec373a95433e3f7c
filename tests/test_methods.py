"""How constraints are projected: each method against NumPy, SciPy or a closed form, and where it converges."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from models import rope_model, state
from scipy.optimize import root

import pbd_warp as pbd
from pbd_warp import references
from pbd_warp.methods.gauss_seidel import colours
from pbd_warp.methods.jacobi import PLAIN_ITERATIONS, chebyshev_factors, spectral_radius

EPS = {"float32": float(np.finfo(np.float32).eps), "float64": float(np.finfo(np.float64).eps)}
SCHEMES = {"pbd": False, "midpoint": True}  # and whether forces act along the mean of both configurations
both_schemes = pytest.mark.parametrize("integrator", SCHEMES)
both_precisions = pytest.mark.parametrize("dtype", EPS)


def run(model, frames=1, check=None, **settings):
    """A simulation after some frames; `check` sees it after each."""
    sim = pbd.Simulation(model, **settings)
    for _ in range(frames):
        sim.step()
        if check is not None:
            check(sim)
    return sim


def converged(sim):
    assert sim.unconverged == 0


def rope_between(positions, masses, pinned, dtype="float64", **kwargs):
    builder = pbd.ModelBuilder()
    builder.add_rope(positions, mass=masses, pinned=pinned, **kwargs)
    return builder.finalize(dtype=dtype)


# Direct: one step is the solution of its nonlinear equations.


def random_chain(case, rng, n=8):
    """A bent chain whose lengths fit but for a little, moving at random; what it has besides depends on the case."""
    builder = pbd.ModelBuilder()
    x = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    mass = 10.0 ** rng.uniform(-3, 3, n) if case == "mass ratios" else rng.uniform(0.5, 2.0, n)
    fixed = {"fixed ends": [0, n - 1], "fixed inside": [3], "fixed everywhere": [0, 3, 4, n - 1], "points": [n - 1]}
    mass[fixed.get(case, [])] = 0.0
    v = np.where(mass[:, None] > 0, rng.normal(size=(n, 3)), 0.0)
    builder.add_particles(x, v, mass)
    rest = np.linalg.norm(np.diff(x, axis=0), axis=1) * rng.uniform(0.999, 1.001, n - 1)
    if case == "fixed everywhere":
        rest[3] = np.linalg.norm(x[4] - x[3])  # between fixed particles nothing can give
    compliance = np.zeros(n - 1)
    if case in ("compliance", "points"):
        compliance[rng.permutation(n - 1)[: n // 2]] = 10.0 ** rng.uniform(-5, -2, n // 2)
    builder.add_distances([(k, k + 1) for k in range(n - 1)], rest, compliance=compliance)
    if case == "points":
        builder.add_point(2, x[2] + 0.01, compliance=1e-3)
        builder.add_point(5, x[5] - 0.01)
        builder.add_point(0, x[0] + 0.02, compliance=1e-4)
    return builder.finalize(dtype="float64")


def balance(model, x, base, scale, mean, u, lam):
    """What is left of momentum [m], shape [n, 3], and of each distance [m], with lam = force times `scale` over mass.

    The force of a compliant link is its stretch over its compliance, for "midpoint" the mean of those at both ends of
    the step; particles that a rigid point or no mass holds have no equation but their own place.
    """
    edge, rest = model.distance.edge, model.distance.rest_length
    start, end = (p[edge[:, 0]] - p[edge[:, 1]] for p in (x, x + u))
    start_length, end_length = np.linalg.norm(start, axis=1), np.linalg.norm(end, axis=1)
    g = (start + end) / (start_length + end_length)[:, None] if mean else end / end_length[:, None]
    soft = model.distance.compliance > 0.0
    stretch = np.where(mean & soft, (start_length + end_length) / 2, end_length) - rest
    momentum = u - base
    for (i, j), pull in zip(edge, g * lam[:, None], strict=True):
        momentum[i] -= model.w[i] * pull
        momentum[j] += model.w[j] * pull
    for p, target, compliance in zip(model.point.particle, model.point.target, model.point.compliance, strict=True):
        away = x[p] + u[p] - target
        if compliance > 0.0:
            momentum[p] += model.w[p] * scale / compliance * ((x[p] - target + away) / 2 if mean else away)
        else:
            momentum[p] = away
    momentum[model.w == 0.0] = u[model.w == 0.0]
    return momentum, stretch + model.distance.compliance / scale * lam


CASES = ["free", "fixed ends", "fixed inside", "fixed everywhere", "compliance", "points", "mass ratios"]


def direct_steps(model, integrator, steps):
    """Of the last of some steps: x before it, base, the integrator's force scale, u and lam link by link."""
    h = 1 / 240
    sim = pbd.Simulation(model, dt=h, method=pbd.Direct(), integrator=integrator)
    for _ in range(steps):
        x, v = state(sim)
        sim.step()
        assert sim.unconverged == 0
    free = (model.w > 0.0)[:, None]
    part = 0.5 if SCHEMES[integrator] else 1.0
    base = np.where(free, h * v + part * h * h * model.gravity, 0.0)
    vertex, lam = sim.solver._vertex.numpy(), sim.solver._lam.numpy()
    assert sorted(vertex) == list(range(len(vertex)))
    lam = lam[:-1] if vertex[0] == 0 else lam[:-1][::-1]
    return x, base, part * h * h, sim.u.numpy(), lam


@both_schemes
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("steps", [1, 3])
def test_direct_balances_momentum_and_lengths_to_round_off(case, integrator, steps, rng):
    model = random_chain(case, rng)
    x, base, scale, u, lam = direct_steps(model, integrator, steps)
    momentum, stretch = balance(model, x, base, scale, SCHEMES[integrator], u, lam)
    if case == "fixed everywhere":
        stretch[3] = 0.0  # between fixed particles: no unknown, no equation
    # Newton stops at 16 epsilons of the longest link, some 4 m; forces move a light particle by w lam and more.
    size = np.abs(x).max() + np.abs(u).max() + (model.w.max() * np.abs(lam)).max()
    np.testing.assert_allclose(stretch, 0.0, atol=64 * EPS["float64"] * size)
    np.testing.assert_allclose(momentum, 0.0, atol=64 * EPS["float64"] * size)
    assert np.abs(u - base).max() > 1e-6, "nothing was to be done"


@both_schemes
@pytest.mark.parametrize("case", CASES)
def test_direct_is_the_solution_that_scipy_finds(case, integrator, rng):
    """Powell's method on all equations at once, from the displacement without constraints."""
    model = random_chain(case, rng)
    x, base, scale, u, lam = direct_steps(model, integrator, steps=1)
    locked = model.point.particle[model.point.compliance == 0.0]
    weight = np.where(model.w > 0.0, 1.0 / np.maximum(model.w, 1e-300), 1.0)[:, None]  # residuals as impulses
    start = base.copy()
    start[locked] = model.point.target[model.point.compliance == 0.0] - x[locked]

    def equations(z):
        momentum, stretch = balance(
            model, x, base, scale, SCHEMES[integrator], z[: u.size].reshape(u.shape), z[u.size :]
        )
        if case == "fixed everywhere":
            stretch[3] = z[u.size + 3]
        return np.concatenate([(weight * momentum).ravel(), stretch])

    solution = root(equations, np.concatenate([start.ravel(), 0 * lam]), tol=1e-14, options={"maxfev": 20000})
    assert np.abs(equations(solution.x)).max() < 1e-10
    if case == "fixed everywhere":
        lam[3] = 0.0
    # SciPy's Jacobian is one of differences: it stops at a step of some 1e-10 of the largest unknown.
    np.testing.assert_allclose(solution.x[: u.size].reshape(u.shape), u, atol=1e-8)
    np.testing.assert_allclose(solution.x[u.size :], lam, atol=1e-8 * max(np.abs(lam).max(), 1.0))


# Direct: long ropes.

LINKS = 1000


def long_rope(dtype, length=1.0):
    positions = np.linspace([0.0, 0, 0], [length, 0, 0], LINKS + 1)
    return rope_between(positions, 1.0, (0,), dtype)


def rounding(sim):
    """What a link's stretch owes to the rounding of two stored coordinates."""
    x = state(sim)[0]
    return EPS[sim.model.dtype] * np.abs(x).max() / sim.model.distance.rest_length.min()


def test_a_rope_of_1000_links_keeps_its_length_through_the_whip():
    """Level at first, it hangs down after some 0.5 s; its end then moves fastest."""
    worst, end = [], []

    def check(sim):
        converged(sim)
        worst.append(pbd.measure(sim).max_stretch)
        end.append(state(sim)[0][-1, 1])

    sim = run(long_rope("float64"), 45, check, substeps=16, method=pbd.Direct())
    assert max(worst) < 1e-10
    assert max(worst) < 4 * rounding(sim)
    assert min(end) < -0.9, "it has not swung"


@pytest.mark.parametrize("substeps", [16, 4, 1])
@pytest.mark.parametrize("length", [1.0, 100.0])
def test_a_rope_of_1000_links_in_float32_keeps_its_length_to_rounding(substeps, length):
    """Four times: both ends of a link are rounded, each in three coordinates."""

    def check(sim):
        assert pbd.measure(sim).max_stretch < 4 * rounding(sim)

    sim = run(long_rope("float32", length), 18, check, substeps=substeps, method=pbd.Direct())
    assert state(sim)[0][-1, 1] < -0.3, "it has not fallen"


@pytest.mark.parametrize("substeps", [4, 1])
def test_direct_converges_in_long_steps(substeps):
    """0.3 s; projection along present gradients, without the geometric stiffness, does not."""
    sim = run(long_rope("float64"), 18, converged, substeps=substeps, method=pbd.Direct())
    assert pbd.measure(sim).max_stretch < 1e-10
    assert state(sim)[0][-1, 1] < -0.3, "it has not fallen"


@pytest.mark.parametrize("length", [1.0, 10.0, 100.0])
def test_the_tolerance_by_default_can_be_reached(length):
    run(long_rope("float64", length), 3, converged, substeps=4, method=pbd.Direct())


@pytest.mark.parametrize("ratio", [1.0, 1e3, 1e5])
@pytest.mark.parametrize("substeps", [1, 4])
def test_direct_holds_a_heavy_bob(ratio, substeps):
    """20 links, the last particle `ratio` times as heavy: swinging from level, 0.5 s."""
    masses = np.r_[0.0, np.ones(19), ratio]
    model = rope_between(np.linspace([0.0, 0, 0], [2, 0, 0], 21), masses, (0,))
    sim = run(model, 30, converged, substeps=substeps, method=pbd.Direct(tolerance=1e-10))
    assert pbd.measure(sim).max_stretch < 1e-9  # the tolerance over a link of 0.1 m
    assert state(sim)[0][-1, 1] < -1.0, "it has not swung"


# Direct: the same whatever else there is, and in which order.


def many_ropes(sizes, which=None):
    builder = pbd.ModelBuilder()
    for number, size in enumerate(sizes):
        if which in (None, number):
            x = np.linspace([0.0, number, 0], [1, number, 0.1 * number], size)
            builder.add_rope(x, pinned=(0,) if number % 2 else (), compliance=1e-4 if number == 2 else 0.0)
            if number == 0:
                builder.add_point(builder.particle_count - 1, (1.1, 0.2, 0.0))
    return builder.finalize(dtype="float64")


@pytest.mark.parametrize("integrator", ["pbd", "bdf2", "midpoint4"])
def test_several_ropes_move_as_each_alone(integrator):
    sizes = (2, 17, 5, 40)
    settings = {"frames": 10, "substeps": 2, "method": pbd.Direct(tolerance=1e-13), "integrator": integrator}
    together = state(run(many_ropes(sizes), **settings))
    first = 0
    for number, size in enumerate(sizes):
        alone = state(run(many_ropes(sizes, number), **settings))
        for a, b in zip(together, alone, strict=True):
            np.testing.assert_array_equal(a[first : first + size], b)
        first += size


@both_schemes
def test_order_and_direction_of_the_edges_do_not_matter(integrator, rng):
    n = 12
    x = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    mass = np.r_[rng.uniform(0.5, 2.0, n - 1), 0.0]
    edges = np.array([(k, k + 1) for k in range(n - 1)])
    results = []
    for shuffled in (False, True):
        order = rng.permutation(n) if shuffled else np.arange(n)
        name = np.argsort(order)  # particle k of the chain is number name[k]
        edge = name[edges]
        if shuffled:
            edge = rng.permuted(rng.permutation(edge), axis=1)
        builder = pbd.ModelBuilder()
        builder.add_particles(x[order], mass=mass[order])
        builder.add_distances(edge)
        sim = run(builder.finalize(dtype="float64"), 10, converged, method=pbd.Direct(), integrator=integrator)
        results.append(state(sim)[0][name])
    assert np.abs(results[0] - x).max() > 0.05, "nothing moved"
    # Another order of elimination rounds otherwise: some epsilons of 10 m a step, grown by the motion.
    np.testing.assert_allclose(results[1], results[0], atol=1e-11)


# Direct with contacts.


def test_a_direct_rope_falls_on_a_plane():
    radius = 0.02
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0.5, 0], [0.8, 0.9, 0], 21), pinned=(), radius=radius)
    builder.add_plane((0, 0, 0), (0, 1, 0), friction=0.3)
    model = builder.finalize(dtype="float64")
    sim = run(model, 60, substeps=4, method=pbd.Direct(10))
    x, v = state(sim)
    assert np.isfinite(v).all()
    assert x[:, 1].max() < 0.5, "it has not fallen"
    now = pbd.measure(sim)
    assert now.overlap < 0.1 * radius
    assert now.max_stretch < 1e-3


def test_a_direct_rope_drapes_over_a_sphere():
    radius, ball = 0.02, 0.3
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([-0.8, 0.4, 0], [0.8, 0.4, 0], 41), pinned=(), radius=radius)
    builder.add_sphere((0, 0, 0), ball, friction=0.5)
    overlaps, stretches = [], []

    def check(sim):
        overlaps.append(pbd.measure(sim).overlap)
        stretches.append(pbd.measure(sim).max_stretch)

    sim = run(builder.finalize(dtype="float64"), 40, check, substeps=4, method=pbd.Direct(10))
    x, v = state(sim)
    assert np.isfinite(v).all()
    assert x[[0, -1], 1].max() < 0.0, "its ends do not hang down"
    assert np.linalg.norm(x, axis=1).min() > ball
    assert max(overlaps) < 0.1 * radius
    assert max(stretches) < 1e-3


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
    """Newton squares the error: from 1e-3 to 1e-5 there may be nothing to do."""
    used = [run(rope_model(9), 1, method=SOLVERS[solver](t)).iterations_used for t in (1e-3, 1e-5, 1e-9, 1e-12)]
    assert used == sorted(used)
    assert len(set(used)) >= 3


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
    """C_k <- (C_{k-1} + 2 C_k + C_{k+1}) / 4, but at the ends, which have other denominators: so rho is not quite
    (1 + cos(pi/N)) / 2 for N = links, and lies below that for two links more."""
    rho = spectral_radius(rope_model(links + 1, pinned=()), pbd.Jacobi())
    low, high = ((1 + np.cos(np.pi / n)) / 2 for n in (links, links + 2))
    assert low < rho < high


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


# Compliance.


@pytest.mark.parametrize("method", [pbd.Jacobi, pbd.GaussSeidel, pbd.Direct])
@pytest.mark.parametrize("iterations", [1, 3, 20])
def test_a_compliant_spring_is_the_implicit_oscillator(method, iterations):
    """For every number of iterations; Direct is exact at once because one link does not turn."""
    compliance, mass, h, n = 0.01, 2.0, 1 / 60, 50
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1.25, 0, 0)], mass=[0.0, mass])
    builder.add_distance(0, 1, rest_length=1.0, compliance=compliance)
    settings = {"method": method(iterations), "on_failure": "continue"}  # one Newton iteration does not know its error
    sim = run(builder.finalize(dtype="float64"), dt=n * h, substeps=n, **settings)
    exact = references.implicit_oscillator(n, h, 1.25, mass, compliance, 1.0)
    assert abs(exact - 1.25) > 0.01
    # Each of n steps rounds values of size 1, and the oscillator carries every error on for up to n steps.
    assert abs(state(sim)[0][1, 0] - exact) <= n * n * EPS["float64"]


SETTLED = {
    # Iterations that leave round-off or little more; a sweep's contraction is some (1 + cos(pi/10)) / 2.
    "jacobi": (pbd.Jacobi(20000, tolerance=1e-13), 1e-7),
    "gauss-seidel": (pbd.GaussSeidel(20000, tolerance=1e-13), 1e-7),
    "direct": (pbd.Direct(), 1e-9),
}


@pytest.mark.parametrize("name", SETTLED)
@pytest.mark.parametrize("substeps", [1, 3])
def test_tensions_and_stretch_of_a_hanging_chain(name, substeps):
    """T_i = g sum_{j >= i} m_j, stretch compliance T_i, |lam_i| over the force scale = T_i."""
    method, rtol = SETTLED[name]
    masses, compliance = np.linspace(0.1, 2.0, 10), 1e-4
    x, tension = references.hanging_chain(masses, 0.1, compliance)
    builder = pbd.ModelBuilder()
    builder.add_particles(x, mass=np.r_[0.0, masses])
    builder.add_distances([(k, k + 1) for k in range(10)], rest_length=0.1, compliance=compliance)
    sim = run(builder.finalize(dtype="float64"), 3, converged, substeps=substeps, method=method)
    if name == "direct":
        lam = sim.solver._lam.numpy()[:-1]
        lam = lam if sim.solver._vertex.numpy()[0] == 0 else lam[::-1]
    elif name == "jacobi":
        lam = sim.arrays["distance.lam"].numpy()
    else:
        lam = np.zeros(10)
        for colour, group in enumerate(colours(sim.model.distance.edge)):
            lam[group] = sim.arrays[f"distance.{colour}.lam"].numpy()
    np.testing.assert_allclose(-lam / sim.substep_dt**2, tension, rtol=rtol)
    stretch = np.linalg.norm(np.diff(state(sim)[0], axis=0), axis=1) - 0.1
    np.testing.assert_allclose(stretch, compliance * tension, rtol=rtol)


def elastic_catenary(start=(0, 0, 0)):
    """A model of 12 springs between two fixed ends, moved by `start` from where it rests; and where that is."""
    links, length, compliance = 12, 0.1, 1e-3
    x, tension = references.elastic_catenary(links, length, 0.9, 0.2, compliance)
    assert (compliance * tension).max() > 0.01 * length, "it should stretch"
    inside = np.r_[0.0, np.ones(links - 1), 0.0]
    builder = pbd.ModelBuilder()
    builder.add_particles(x + inside[:, None] * start, mass=0.2 * inside)
    builder.add_distances([(k, k + 1) for k in range(links)], rest_length=length, compliance=compliance)
    return builder.finalize(dtype="float64"), x


@pytest.mark.parametrize("integrator", ["pbd", "midpoint", "midpoint4"])
def test_an_elastic_catenary_stays_at_rest(integrator):
    """One second. The forces of "bdf2" do not balance in its first step, in which a compliance counts as 9/4."""
    model, x = elastic_catenary()
    sim = run(model, 60, converged, method=pbd.Direct(), integrator=integrator)
    np.testing.assert_allclose(state(sim)[0], x, atol=1e-11)


@pytest.mark.parametrize("name", ["jacobi", "gauss-seidel"])
def test_where_xpbd_rests_differs_by_the_second_power_of_the_step(name):
    """Multipliers act along the directions that the links had in each iteration, not along the last one: converged in
    length, not in momentum. Direct solves both. Four times the substeps: 1/16, and more in long steps."""
    model, x = elastic_catenary()
    off = []
    for substeps in (1, 4):
        sim = run(model, 10, converged, substeps=substeps, method=SETTLED[name][0])
        off.append(np.abs(state(sim)[0] - x).max())
    assert off[0] < 2e-3
    assert off[1] < off[0] / 5


def test_a_disturbed_elastic_catenary_comes_to_rest_where_it_should():
    """Implicit Euler itself damps: 40 long steps."""
    model, x = elastic_catenary(start=(0.0, 0.05, 0.02))
    sim = run(model, 40, converged, dt=2.0, method=pbd.Direct(200, tolerance=1e-12))
    np.testing.assert_allclose(state(sim)[0], x, atol=1e-5 * 1.2)  # of its length


@pytest.mark.parametrize(("links", "span"), [(10, 0.6), (11, 0.9), (32, 0.2)])
@pytest.mark.parametrize("integrator", ["pbd", "bdf2", "midpoint", "midpoint4"])
def test_an_inextensible_catenary_stays_at_rest(links, span, integrator):
    """One second; the masses differ."""
    masses = np.linspace(0.5, 2.0, links - 1)
    x = references.catenary(links, 1 / links, span, masses)
    model = rope_between(x, np.r_[0.0, masses, 0.0], (0, -1))
    sim = run(model, 60, method=pbd.Direct(), integrator=integrator)
    # The reference is of round-off; the slightest imbalance of 1e-15 moves it for a second, some g t^2 times that.
    np.testing.assert_allclose(state(sim)[0], x, atol=1e-9)


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
        (star(), pbd.Direct(), "particle 0 has 3 distances: method 'direct' needs paths"),
        (loop(), pbd.Direct(), "closed loop: method 'direct' needs paths"),
        (double_edge(), pbd.Direct(), "closed loop: method 'direct' needs paths"),
        (rope_with(stiffness=0.5), pbd.Direct(), "soften with compliance instead of a stiffness below 1"),
        (rope_with(rest_length=[1.0, 0.0]), pbd.Direct(), "needs rest lengths above 0"),
        (rope_with(points=(1, 1)), pbd.Direct(), "one point constraint a particle, but particle 1 has more"),
        (rope_with(contacts=True), pbd.Jacobi(chebyshev=0.9), "chebyshev is for rigid constraints without contacts"),
        (rope_with(compliance=1e-3), pbd.Jacobi(chebyshev="auto"), "chebyshev is for rigid constraints"),
    ],
    ids=["star", "loop", "double", "stiffness", "rest length 0", "two points", "contacts", "compliance"],
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
