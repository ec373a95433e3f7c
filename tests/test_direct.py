"""Direct: Newton's method along paths."""

import numpy as np
import pytest
from models import state
from scipy.optimize import root
from solving import EPS, converged, rope_between, run

import pbd_warp as pbd

SCHEMES = {"pbd": False, "midpoint": True}  # and whether forces act along the mean of both configurations
both_schemes = pytest.mark.parametrize("integrator", SCHEMES)

# One step is the solution of its nonlinear equations.


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
    scale = part * h * h
    return x, base, scale, sim._context.u.numpy(), -scale * sim._loop.solver.tension()


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


# Long ropes.

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


# The same whatever else there is, and in which order.


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


# With contacts.


def test_a_direct_rope_falls_on_a_plane():
    radius = 0.02
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0.5, 0], [0.8, 0.9, 0], 21), pinned=(), radius=radius)
    builder.add_plane((0, 0, 0), (0, 1, 0), friction=0.3)
    model = builder.finalize(dtype="float64")
    # Pushed together as it hits, a rope that is straight may take more than the iterations there are.
    sim = run(model, 60, substeps=4, method=pbd.Direct(), on_failure="subdivide")
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

    sim = run(builder.finalize(dtype="float64"), 40, check, substeps=4, method=pbd.Direct())
    x, v = state(sim)
    assert np.isfinite(v).all()
    assert x[[0, -1], 1].max() < 0.0, "its ends do not hang down"
    assert np.linalg.norm(x, axis=1).min() > ball
    assert max(overlaps) < 0.1 * radius
    assert max(stretches) < 1e-3
