"""Cases in which physics, or the scheme itself, has an exact answer."""

import itertools

import numpy as np
import pytest
from models import rope_model, state

import pbd_warp as pbd

EPS = {"float32": 2.0**-24, "float64": 2.0**-53}  # largest relative error of one rounding
both_precisions = pytest.mark.parametrize("dtype", EPS)


def particles(positions, velocity=(0, 0, 0), mass=1.0, radius=0.0, gravity=(0, 0, 0), dtype="float64", contacts=None):
    builder = pbd.ModelBuilder(gravity=gravity)
    builder.add_particles(positions, velocity, mass, radius)
    if contacts is not None:
        builder.enable_contacts(**contacts)
    return builder.finalize(dtype=dtype)


# Free fall: x_n = x0 + n h v0 + g h^2 n (n + 1) / 2.


@both_precisions
@pytest.mark.parametrize("start", [0.0, 1.0, 10.0, 100.0])
@pytest.mark.parametrize("rate", [60, 600, 6000])
def test_free_fall(dtype, start, rate):
    g, n, h = -9.81, rate // 10, 1.0 / rate
    sim = pbd.Simulation(particles([(0, start, 0)], gravity=(0, g, 0), dtype=dtype), dt=0.1, substeps=n)
    sim.step()
    x, v = state(sim)
    exact = start + g * h * h * n * (n + 1) / 2
    # n sums round x, and n sums round v, which then acts for n steps.
    bound = (n + 2) * EPS[dtype] * (abs(start) + 1.0) + n * n * h * EPS[dtype] * abs(g * n * h)
    assert abs(x[0, 1] - exact) <= bound
    assert abs(v[0, 1] - g * n * h) <= n * EPS[dtype] * abs(g * n * h) + EPS[dtype]


def test_displacements_do_not_freeze_where_positions_do():
    """The textbook's p = x + h v, v = (p - x) / h in float32: at 10 m and 1/6000 s nothing ever moves."""
    x, v, h, g = np.float32(10), np.float32(0), np.float32(1 / 6000), np.float32(-9.81)
    for _ in range(600):
        v = v + h * g
        p = x + h * v
        v, x = (p - x) / h, p
    assert x == 10.0
    assert v == 0.0
    sim = pbd.Simulation(particles([(0, 10, 0)], gravity=(0, -9.81, 0), dtype="float32"), dt=0.1, substeps=600)
    sim.step()
    assert state(sim)[0][0, 1] == pytest.approx(10.0 - 9.81 * 0.1**2 / 2 * (1 + 1 / 600), abs=600 * 10 * 2.0**-24)


# Stiffness and compliance.


@both_precisions
@pytest.mark.parametrize("k", [0.1, 0.5, 0.9, 1.0])
@pytest.mark.parametrize("iterations", [1, 2, 7, 20])
def test_stiffness_leaves_one_minus_k_for_every_number_of_iterations(dtype, k, iterations):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1.5, 0, 0)], mass=[1.0, 3.0])
    builder.add_distance(0, 1, rest_length=1.0, stiffness=k)
    sim = pbd.Simulation(builder.finalize(dtype=dtype), method=pbd.Jacobi(iterations))
    sim.step()
    assert pbd.measure(sim).residual == pytest.approx(0.5 * (1.0 - k), abs=4 * (iterations + 1) * EPS[dtype])


@both_precisions
@pytest.mark.parametrize("iterations", [1, 3, 20])
def test_a_compliant_spring_is_the_implicit_oscillator(dtype, iterations):
    """x_n - 1 = r^n (c1 cos n theta + c2 sin n theta), r = (1 + w^2 h^2)^(-1/2), theta = atan(w h)."""
    compliance, mass, h, n = 0.01, 2.0, 1 / 60, 50
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1.25, 0, 0)], mass=[0.0, mass])
    builder.add_distance(0, 1, rest_length=1.0, compliance=compliance)
    sim = pbd.Simulation(builder.finalize(dtype=dtype), dt=n * h, substeps=n, method=pbd.Jacobi(iterations))
    sim.step()
    wh = h / np.sqrt(compliance * mass)
    r, theta = 1.0 / np.hypot(1.0, wh), np.arctan(wh)
    # From the state before the start, x_-1 = x_0 (at rest): r^-1 (c1 cos theta - c2 sin theta) = c1.
    c1 = 0.25
    c2 = c1 * (np.cos(theta) - r) / np.sin(theta)
    exact = 1.0 + r**n * (c1 * np.cos(n * theta) + c2 * np.sin(n * theta))
    # Each of n steps rounds values of size 1, and the oscillator carries every error on for up to n steps.
    assert abs(state(sim)[0][1, 0] - exact) <= n * n * EPS[dtype]


# Momentum.


def bent_rope(n, dtype, rng, gravity=(0, -9.81, 0)):
    builder = pbd.ModelBuilder(gravity=gravity)
    x = np.cumsum(rng.normal(size=(n, 3)), axis=0)
    builder.add_particles(x, rng.normal(size=(n, 3)), mass=rng.uniform(0.5, 2.0, n))
    builder.add_distances([(i, i + 1) for i in range(n - 1)], rest_length=1.0)
    return builder.finalize(dtype=dtype)


@both_precisions
@pytest.mark.parametrize("averaging", ["mass-splitting", "none"])
def test_a_free_worm_keeps_its_momentum_and_its_centroid_falls(dtype, averaging, rng):
    model = bent_rope(65, dtype, rng)
    method = pbd.Jacobi(50, averaging=averaging, relaxation=0.9)
    sim = pbd.Simulation(model, method=method)
    before = pbd.measure(sim).momentum
    m = 1.0 / model.w
    sim.step()
    after = pbd.measure(sim).momentum
    fall = m.sum() * model.gravity / 60
    size = 50 * np.abs(m).sum() * np.abs(model.x).max()  # sweeps times what each may round
    np.testing.assert_allclose(after - before, fall, atol=size * 60 * EPS[dtype])
    centroid = m @ (state(sim)[0] - model.x)
    np.testing.assert_allclose(centroid, (before + fall) / 60, atol=size * EPS[dtype])


def test_valence_averaging_leaks_momentum(rng):
    """What mass splitting cures: the ends of a rope have one constraint, the others two."""
    sim = pbd.Simulation(bent_rope(65, "float64", rng), method=pbd.Jacobi(50, averaging="valence"))
    before = pbd.measure(sim).momentum
    sim.step()
    mass = (1.0 / sim.model.w).sum()
    drift = (pbd.measure(sim).momentum - before) / mass / 60 - sim.model.gravity / 3600
    assert np.linalg.norm(drift) > 1e-3


# Contacts.


@both_precisions
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("m1", "m2"), [(1.0, 1.0), (1.0, 4.0), (100.0, 1.0)])
def test_two_particles_collide_by_the_law_of_impact(dtype, e, m1, m2):
    model = particles(
        [(0, 0, 0), (0.5, 0, 0)], [(3, 0, 0), (-1, 0, 0)], [m1, m2], 0.2, dtype=dtype, contacts={"restitution": e}
    )
    sim = pbd.Simulation(model)
    for _ in range(10):
        sim.step()
    v = state(sim)[1][:, 0]
    exact = [((m1 - e * m2) * 3 - (1 + e) * m2) / (m1 + m2), (-(m2 - e * m1) + (1 + e) * m1 * 3) / (m1 + m2)]
    # A velocity is a displacement of some 1 m rounded, over a step of 1/60 s.
    np.testing.assert_allclose(v, exact, atol=60 * 8 * EPS[dtype])


@pytest.mark.parametrize("e", [0.0, 1.0])
@pytest.mark.parametrize("phase", np.linspace(0.0, 1.0, 21))
@pytest.mark.parametrize("travel", [2.5, 7.0, 100.0])
def test_a_bullet_never_misses(e, phase, travel):
    """Relative travel a step of 2.5 and more times r1 + r2: at every phase of the step it hits."""
    rest = 0.1
    speed = travel * rest * 60
    start = -(rest + phase * travel * rest + 1e-9)
    model = particles(
        [(start, 0, 0), (0, 0, 0)], [(speed, 0, 0), (0, 0, 0)], radius=rest / 2, contacts={"restitution": e}
    )
    sim = pbd.Simulation(model)
    for _ in range(3):
        sim.step()
        x, v = state(sim)
        assert x[1, 0] - x[0, 0] >= rest * (1 - 1e-12)
    np.testing.assert_allclose(v[:, 0], [(1 - e) * speed / 2, (1 + e) * speed / 2], atol=1e-12 * speed)


@pytest.mark.parametrize("phase", np.linspace(0.0, 1.0, 11))
@pytest.mark.parametrize("shape", ["plane", "sphere"])
def test_a_bullet_never_goes_through_a_collider(phase, shape):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particle((0, 1.1 + 5.0 * phase, 0), velocity=(0, -300, 0), radius=0.1)
    if shape == "plane":
        builder.add_plane((0, 1, 0), (0, 1, 0))
    else:
        builder.add_sphere((0, 0, 0), 1.0)
    sim = pbd.Simulation(builder.finalize(dtype="float64"))
    for _ in range(3):
        sim.step()
    x, v = state(sim)
    # It stops where it comes in: at 1.1 m, one radius above the surface.
    np.testing.assert_allclose(x[0], [0, 1.1, 0], atol=1e-12)
    np.testing.assert_allclose(v[0], 0.0, atol=1e-12)


@pytest.mark.parametrize("dodge", [1.02, 1.2])
def test_a_bullet_that_passes_by_is_not_touched(dodge):
    model = particles([(-1, 0, 0), (0, 0.1 * dodge, 0)], [(120, 0, 0), (0, 0, 0)], radius=0.05, contacts={})
    sim = pbd.Simulation(model)
    for _ in range(3):
        sim.step()
    np.testing.assert_allclose(state(sim)[1], [(120, 0, 0), (0, 0, 0)], rtol=1e-12)


def test_a_sliding_particle_is_slowed_by_coulomb_friction():
    """v_n = v_0 - n h mu g, and no further than to rest."""
    mu, g = 0.3, 9.81
    builder = pbd.ModelBuilder(gravity=(0, -g, 0))
    builder.add_particle((0, 0.1, 0), velocity=(2, 0, 0), radius=0.1)
    builder.add_plane((0, 0, 0), (0, 1, 0), friction=mu)
    sim = pbd.Simulation(builder.finalize(dtype="float64"))
    for frame in range(1, 60):
        sim.step()
        assert state(sim)[1][0, 0] == pytest.approx(max(2.0 - frame / 60 * mu * g, 0.0), abs=1e-12)


def test_a_perfectly_elastic_ball_at_rest_stays_at_rest():
    """What gravity adds in a step is no impact; without the threshold it would bounce for ever."""
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 0.1, 0), radius=0.1)
    builder.add_plane((0, 0, 0), (0, 1, 0), restitution=1.0)
    sim = pbd.Simulation(builder.finalize(dtype="float64"))
    for _ in range(20):
        sim.step()
        assert abs(state(sim)[1][0, 1]) < 1e-12
    assert state(sim)[0][0, 1] == pytest.approx(0.1, abs=1e-12)


@pytest.mark.parametrize(("slope", "moves"), [(0.28, False), (0.32, True)])
def test_a_particle_rests_on_a_slope_below_the_angle_of_friction(slope, moves):
    builder = pbd.ModelBuilder()
    normal = np.array([-slope, 1.0, 0.0]) / np.hypot(slope, 1.0)
    builder.add_particle(0.1 * normal, radius=0.1)
    builder.add_plane((0, 0, 0), normal, friction=0.3)
    sim = pbd.Simulation(builder.finalize(dtype="float64"))
    for _ in range(30):
        sim.step()
    moved = np.linalg.norm(state(sim)[0][0] - 0.1 * normal)
    # g (sin - mu cos) t^2 / 2 where it moves; where it rests, not at all.
    exact = 9.81 * (0.32 - 0.3) / np.hypot(0.32, 1.0) * (0.5**2 + 0.5 / 60) / 2
    assert moved == pytest.approx(exact if moves else 0.0, abs=1e-9)


# Damping.


@both_precisions
def test_damping_keeps_the_momentum_of_a_moving_worm(dtype, rng):
    """Angular momentum and rigidity are tested on the kernels: the projection of "pbd" does not keep them."""
    model = bent_rope(12, dtype, rng, gravity=(0, 0, 0))
    sim = pbd.Simulation(model, damping=1.0)
    first = pbd.measure(sim)
    for _ in range(3):
        sim.step()
    scale = 20 * 3 * 60 * np.abs(model.x).max() * (1.0 / model.w).sum() * EPS[dtype]
    np.testing.assert_allclose(pbd.measure(sim).momentum, first.momentum, atol=scale)


@pytest.mark.parametrize("substeps", [1, 2, 8])
def test_damping_a_frame_does_not_depend_on_the_substeps(substeps):
    """Two particles moving apart along their line: all of that is damped, by k a frame."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1, 0, 0)], [(-1, 0, 0), (1, 0, 0)])
    builder.add_distance(0, 1, stiffness=0.0)  # joins them to one component, and nothing else
    sim = pbd.Simulation(builder.finalize(dtype="float64"), substeps=substeps, damping=0.36)
    sim.step()
    np.testing.assert_allclose(state(sim)[1][:, 0], [-0.64, 0.64], rtol=1e-12)


# Degenerate graphs: finite whatever happens, and what can be solved is.


def star(spokes, planar, dtype="float64"):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    angle = 2 * np.pi * np.arange(spokes) / spokes
    z = 0 * angle if planar else np.linspace(-0.9, 0.9, spokes)
    r = np.sqrt(1 - z**2)
    ends = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    builder.add_particles([(0.01, 0.02, 0), *(1.5 * ends)])
    builder.add_distances([(0, i + 1) for i in range(spokes)], rest_length=1.0)
    return builder.finalize(dtype=dtype)


@both_precisions
@pytest.mark.parametrize(("spokes", "planar"), [*itertools.product((4, 5, 6, 7, 9, 16), (True, False))])
def test_the_residual_of_a_star_falls(dtype, spokes, planar):
    sim = pbd.Simulation(star(spokes, planar, dtype), method=pbd.Jacobi(200))
    sim.step()
    residual = pbd.measure(sim).residual
    assert residual < 1e-3 * 0.5


@pytest.mark.parametrize("times", [2, 3])
def test_a_constraint_given_more_than_once(times):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1.01, 0, 0)])
    builder.add_distances([(0, 1)] * times, rest_length=1.0)
    model = builder.finalize(dtype="float64")
    sim = pbd.Simulation(model, method=pbd.Jacobi(5))
    sim.step()
    assert pbd.measure(sim).residual < 1e-14
    # What mass splitting cures: summed, every sweep turns the error into (1 - times) of it.
    plain = pbd.Simulation(model, method=pbd.Jacobi(5, averaging="none"))
    plain.step()
    assert pbd.measure(plain).residual == pytest.approx(0.01 * (times - 1) ** 5, rel=1e-9)


def degenerate(name):
    builder = pbd.ModelBuilder()
    settings = {}
    circle = [(np.cos(a), np.sin(a), 0) for a in np.linspace(0, 2 * np.pi, 7)[:-1]]
    ring = [(i, (i + 1) % 6) for i in range(6)]
    if name == "coincident":
        builder.add_particles([(1, 1, 1)] * 5)
        builder.add_distances([(i, i + 1) for i in range(4)], rest_length=0.5)
    elif name == "coincident in contact":
        builder.add_particles([(1, 1, 1)] * 3, radius=0.1)
        builder.enable_contacts()
    elif name == "closed loop":
        builder.add_graph(circle, ring)
    elif name == "loop that cannot close":
        builder.add_particles(circle)
        builder.add_distances(ring, rest_length=[1, 1, 1, 1, 1, 9])
    elif name == "both ends fixed":
        builder.add_rope([(0, 0, 0), (1, 0, 0), (2, 0, 0)], pinned=(0, -1))
        builder.add_rope([(0, 1, 0), (1, 1, 0)], pinned=(0, 1))
    elif name == "tiny compliance":
        builder.add_rope([(0, 0, 0), (1, 0, 0), (2, 0, 0)], compliance=1e-12)
    elif name == "a step of 1 s":
        builder.add_rope([(0, 0, 0), (1, 0, 0), (2, 0, 0)])
        settings = {"dt": 1.0}
    elif name == "rest length 0":
        builder.add_particles([(0, 0, 0), (0, 0, 0), (1, 0, 0)])
        builder.add_distances([(0, 1), (1, 2)], rest_length=0.0)
    elif name == "one particle":
        builder.add_particle((0, 0, 0), radius=0.1)
        builder.enable_contacts()
    return builder, settings


@both_precisions
@pytest.mark.parametrize(
    "name",
    [
        "coincident",
        "coincident in contact",
        "closed loop",
        "loop that cannot close",
        "both ends fixed",
        "tiny compliance",
        "a step of 1 s",
        "rest length 0",
        "one particle",
    ],
)
def test_degenerate_graphs_stay_finite(name, dtype):
    builder, settings = degenerate(name)
    sim = pbd.Simulation(builder.finalize(dtype=dtype), damping=0.1, **settings)
    for _ in range(5):
        sim.step()
    x, v = state(sim)
    assert np.isfinite(x).all()
    assert np.isfinite(v).all()
    if name.startswith("coincident"):
        rest = 0.5 if name == "coincident" else 0.2
        nearest = min(np.linalg.norm(x[i] - x[i + 1]) for i in range(len(x) - 1))
        assert nearest > 0.9 * rest, "the pair has not separated"


def test_the_same_rope_far_away_moves_the_same():
    """u as the unknown: constraints see x_i - x_j, which keeps its digits; a power of two keeps x_i itself exact."""
    near = pbd.Simulation(rope_model(9, dtype="float32"), substeps=4)
    model = rope_model(9, dtype="float32")
    model.x[:] += 1024.0
    far = pbd.Simulation(model, substeps=4)
    for _ in range(20):
        near.step()
        far.step()
    ulp = 1024 * 2.0**-23
    shift = state(far)[0] - 1024.0 - state(near)[0]
    assert np.abs(shift).max() < 20 * 4 * ulp
