"""Each reference against something that does not use its formula: balance of forces, conservation, another equation.

Tolerances of integrated motions are those of the integrator; those of closed forms are round-off.
"""

import closed_forms
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import eval_laguerre, jn_zeros, roots_laguerre

from pbd_warp.accuracy import references

G = 9.81
GRAVITY = np.array([0.0, -G, 0.0])


def integrate(rate, start, times):
    """Solution at `times` of state' = rate(state), shape [time_count, state_size]."""
    return solve_ivp(lambda t, s: rate(s), (0, times[-1]), start, "DOP853", t_eval=times, rtol=1e-12, atol=1e-13).y.T


def along_x(n, length):
    x = np.zeros((n, 3))
    x[:, 0] = length * np.arange(n)
    return x


def lengths(x):
    return np.linalg.norm(np.diff(x, axis=-2), axis=-1)


# Chain.


def test_a_chain_keeps_its_lengths_and_its_energy():
    x0, w = along_x(11, 0.1), np.r_[0.0, np.full(10, 1.0)]
    x, v = references.chain(np.linspace(0, 1, 21), x0, 0 * x0, w, GRAVITY)
    energy = 0.5 * np.sum(v**2, axis=(1, 2)) + G * np.sum(x[:, :, 1], axis=1)
    # It starts level, at rest, with the energy 0, and falls: some 20 J are exchanged.
    assert np.sum(v**2, axis=(1, 2)).max() > 40.0
    np.testing.assert_allclose(lengths(x), 0.1, atol=1e-11)
    np.testing.assert_allclose(energy, 0.0, atol=1e-9)
    np.testing.assert_array_equal(x[:, 0], 0.0)


def test_the_velocities_of_a_chain_are_the_rates_of_its_positions():
    x0, w, h = along_x(6, 0.2), np.r_[0.0, np.ones(5)], 1e-3
    x, v = references.chain([0.5 - 2 * h, 0.5 - h, 0.5, 0.5 + h, 0.5 + 2 * h], x0, 0 * x0, w, GRAVITY)
    central = (8 * (x[3] - x[1]) - (x[4] - x[0])) / (12 * h)  # error of order h^4
    np.testing.assert_allclose(v[2], central, atol=1e-7)


def test_a_chain_of_one_link_is_the_pendulum():
    length, theta0, times = 0.7, 1.4, np.linspace(0, 2, 41)
    x0 = np.array([[0, 0, 0], [length * np.sin(theta0), -length * np.cos(theta0), 0]])
    x, _ = references.chain(times, x0, 0 * x0, [0.0, 3.0], GRAVITY)
    theta = references.pendulum_angle(times, theta0, length)
    np.testing.assert_allclose(x[:, 1, 0], length * np.sin(theta), atol=1e-10)
    np.testing.assert_allclose(x[:, 1, 1], -length * np.cos(theta), atol=1e-10)


def test_a_chain_is_the_multiple_pendulum_in_angles():
    """Lagrange's equations in the angles phi_i from the horizontal: no constraint is left that could be solved wrongly.

    sum_j M_ij cos(phi_i - phi_j) phi_j'' = -sum_j M_ij sin(phi_i - phi_j) phi_j'^2 - g a_i S_i cos(phi_i), with
    S_i the mass that hangs on link i and M_ij = a_i a_j S_max(i,j).
    """
    a, m, times = np.array([0.5, 0.3, 0.4]), np.array([1.0, 0.2, 2.5]), np.linspace(0, 1, 11)
    carried = np.cumsum(m[::-1])[::-1]
    i = np.arange(3)
    inertia = np.outer(a, a) * carried[np.maximum.outer(i, i)]

    def rate(state):
        phi, spin = state[:3], state[3:]
        turn = np.subtract.outer(phi, phi)
        torque = -(inertia * np.sin(turn)) @ spin**2 - G * a * carried * np.cos(phi)
        return np.r_[spin, np.linalg.solve(inertia * np.cos(turn), torque)]

    def place(along, across):
        steps = np.stack([a * along, a * across, 0 * along], axis=-1)
        return np.concatenate([np.zeros((*steps.shape[:-2], 1, 3)), np.cumsum(steps, axis=-2)], axis=-2)

    phi0, spin0 = np.array([0.2, -0.5, 1.0]), np.array([1.0, -2.0, 3.0])
    x0 = place(np.cos(phi0), np.sin(phi0))
    v0 = place(-np.sin(phi0) * spin0, np.cos(phi0) * spin0)
    x, v = references.chain(times, x0, v0, np.r_[0.0, 1.0 / m], GRAVITY)
    angles = integrate(rate, np.r_[phi0, spin0], times)
    phi, spin = angles[:, :3], angles[:, 3:]
    np.testing.assert_allclose(x, place(np.cos(phi), np.sin(phi)), atol=1e-9)
    np.testing.assert_allclose(v, place(-np.sin(phi) * spin, np.cos(phi) * spin), atol=1e-8)


def test_a_free_chain_keeps_its_momenta_in_space(rng):
    x0 = np.cumsum(rng.normal(size=(6, 3)), axis=0)
    m = rng.uniform(0.5, 2.0, 6)
    # A rigid rotation stretches nothing; the centroid falls as one particle does.
    v0 = np.array([0.3, 1.0, 0.0]) + np.cross([1.0, 2.0, -0.5], x0)
    times = np.linspace(0, 1, 6)
    x, v = references.chain(times, x0, v0, 1.0 / m, GRAVITY)
    centroid = m @ x / m.sum()
    t = times[:, None]
    np.testing.assert_allclose(centroid, centroid[0] + m @ v0 / m.sum() * t + GRAVITY / 2 * t**2, atol=1e-10)
    arm = x - centroid[:, None]
    spin = np.sum(m[:, None] * np.cross(arm, v), axis=1)
    np.testing.assert_allclose(spin, np.broadcast_to(spin[0], (6, 3)), atol=1e-9 * np.linalg.norm(spin[0]))
    np.testing.assert_allclose(lengths(x), np.broadcast_to(lengths(x0), (6, 5)), atol=1e-10)


def test_fixed_particles_part_a_chain():
    """Two fixed ones in the middle, joined by a link: the parts to either side swing as if alone."""
    x0, times = along_x(8, 0.2), [0.3, 0.6]
    w = np.array([1.0, 2.0, 1.0, 0.0, 0.0, 1.0, 3.0, 1.0])
    v0 = np.zeros((8, 3))
    v0[3:5] = 5.0  # ignored
    x, v = references.chain(times, x0, v0, w, GRAVITY)
    left, _ = references.chain(times, x0[:4], 0 * x0[:4], w[:4], GRAVITY)
    right, _ = references.chain(times, x0[4:], 0 * x0[4:], w[4:], GRAVITY)
    np.testing.assert_allclose(x, np.concatenate([left, right], axis=1), atol=1e-10)
    np.testing.assert_array_equal(v[:, 3:5], 0.0)


def test_a_chain_hung_as_its_catenary_stays():
    x0 = references.catenary(12, 0.1, 0.8)
    w = np.r_[0.0, np.ones(11), 0.0]
    x, _ = references.chain([0.05, 0.1], x0, 0 * x0, w, GRAVITY)
    np.testing.assert_allclose(x, np.stack([x0, x0]), atol=1e-11)
    heavy = references.chain([0.1], x0, 0 * x0, np.r_[0.0, 0.1, np.ones(10), 0.0], GRAVITY)[0][0]
    assert np.abs(heavy - x0).max() > 1e-3, "another distribution of masses must not stay"


@pytest.mark.parametrize(
    ("x0", "v0", "message"),
    [([(0, 0, 0), (1, 0, 0)], [(0, 0, 0), (1, 0, 0)], "stretches link 0"), ([(1, 1, 0)] * 2, [(0, 0, 0)] * 2, "coinc")],
)
def test_a_chain_that_cannot_start(x0, v0, message):
    with pytest.raises(ValueError, match=message):
        references.chain([1.0], x0, v0, [0.0, 1.0], GRAVITY)


# Pendulum.


@pytest.mark.parametrize("theta0", [1e-3, 0.5, np.pi / 2, 3.0, -2.0])
def test_the_pendulum_solves_its_equation(theta0):
    length, times = 0.8, np.linspace(0, 6, 61)
    angles = integrate(lambda s: np.array([s[1], -G / length * np.sin(s[0])]), [theta0, 0.0], times)[:, 0]
    np.testing.assert_allclose(references.pendulum_angle(times, theta0, length), angles, atol=2e-10)


@pytest.mark.parametrize("theta0", [0.3, np.pi / 2, 3.0])
def test_the_pendulum_returns_after_its_period(theta0):
    length = 1.3
    period = closed_forms.pendulum_period(theta0, length)
    parts = references.pendulum_angle(period * np.array([0, 0.25, 0.5, 0.75, 1, 100]), theta0, length)
    np.testing.assert_allclose(parts, [theta0, 0, -theta0, 0, theta0, theta0], atol=1e-12)


def test_the_period_of_small_swings():
    """T = 2 pi sqrt(L/g) (1 + theta0^2/16 + 11 theta0^4/3072 + ...)."""
    theta0 = 0.1
    series = 2 * np.pi * np.sqrt(2.0 / G) * (1 + theta0**2 / 16 + 11 * theta0**4 / 3072)
    assert closed_forms.pendulum_period(theta0, 2.0) == pytest.approx(series, rel=theta0**6 / 1000)


# Chains at rest.


def tensions_and_imbalance(x, forces):
    """Tensions [links] that come nearest to balancing forces on the particles between the ends, and what is left [N].

    Least squares over all components: the balance leaves one unknown for two equations a particle to disagree on.
    """
    d = np.diff(x, axis=0) / lengths(x)[:, None]
    links = len(d)
    matrix = np.zeros((links - 1, 3, links))
    for i in range(1, links):
        matrix[i - 1, :, i] = d[i]
        matrix[i - 1, :, i - 1] = -d[i - 1]
    matrix, load = matrix.reshape(-1, links), -forces.ravel()
    tensions = np.linalg.lstsq(matrix, load, rcond=None)[0]
    return tensions, np.abs(matrix @ tensions - load).max()


@pytest.mark.parametrize("links", [2, 5, 20, 51])
@pytest.mark.parametrize("span", [0.35, 0.6, 0.99])
@pytest.mark.parametrize("kind", ["equal", "random", "growing", "falling"])
def test_every_particle_of_a_catenary_is_in_balance(links, span, kind, rng):
    link_length = 1.0 / links
    masses = {
        "equal": np.ones(links - 1),
        "random": rng.uniform(0.1, 5.0, links - 1),
        "growing": np.logspace(-2, 2, links - 1),
        "falling": np.logspace(2, -2, links - 1),
    }[kind]
    x = references.catenary(links, link_length, span, None if kind == "equal" else masses)
    assert x.shape == (links + 1, 3)
    np.testing.assert_allclose(lengths(x), link_length, rtol=1e-12)
    np.testing.assert_allclose(x[[0, -1]], [(0, 0, 0), (span, 0, 0)], atol=1e-13)
    tensions, imbalance = tensions_and_imbalance(x, masses[:, None] * GRAVITY)
    assert imbalance < 1e-10 * G * masses.sum()
    assert tensions.min() > 0.0
    assert (x[1:-1, 1] < 0.0).all()


def test_a_catenary_of_many_links_is_the_hyperbolic_cosine():
    """y = c (cosh((x - s/2)/c) - cosh(s/(2c))), length 2 c sinh(s/(2c)); the links' error is of second order."""
    c, span = 0.5, 1.0
    length = 2 * c * np.sinh(span / (2 * c))
    errors = []
    for links in (50, 100, 200):
        x = references.catenary(links, length / links, span)
        errors.append(np.abs(x[:, 1] - c * (np.cosh((x[:, 0] - span / 2) / c) - np.cosh(span / (2 * c)))).max())
    slopes = np.diff(np.log(errors)) / np.log(0.5)
    np.testing.assert_allclose(slopes, 2.0, atol=0.1)
    assert errors[-1] < 1e-5


@pytest.mark.parametrize("links", [2, 7, 40])
@pytest.mark.parametrize("span", [0.6, 1.0, 1.7])
@pytest.mark.parametrize("compliance", [1e-9, 1e-3, 1.0])
def test_every_particle_of_an_elastic_catenary_is_in_balance(links, span, compliance):
    mass, a = 0.2, 1.0 / links
    x, tensions = closed_forms.elastic_catenary(links, a, span, mass, compliance)
    np.testing.assert_allclose(x[[0, -1]], [(0, 0, 0), (span, 0, 0)], atol=1e-12 * (1 + np.abs(x).max()))
    np.testing.assert_allclose(lengths(x), a + compliance * tensions, rtol=1e-10)
    pull = tensions[:, None] * np.diff(x, axis=0) / lengths(x)[:, None]
    imbalance = pull[1:] - pull[:-1] + mass * GRAVITY
    assert np.abs(imbalance).max() < 1e-12 * max(tensions.max(), 1.0) + 1e-15 * tensions.max() / a


def test_an_elastic_catenary_tends_to_the_inextensible_one():
    rigid = references.catenary(20, 0.05, 0.7)
    gaps = []
    for compliance in (1e-4, 1e-5, 1e-6, 1e-7):
        x, tensions = closed_forms.elastic_catenary(20, 0.05, 0.7, 0.1, compliance)
        gaps.append(np.abs(x - rigid).max())
    np.testing.assert_allclose(-np.diff(np.log10(gaps)), 1.0, atol=0.02)
    forces, _ = tensions_and_imbalance(rigid, np.full((19, 1), 0.1) * GRAVITY)
    np.testing.assert_allclose(tensions, forces, rtol=1e-4)


@pytest.mark.parametrize(("links", "span"), [(10, 1.0), (10, 0.0), (1, 0.05), (5, 0.1)])
def test_a_catenary_that_cannot_hang(links, span):
    with pytest.raises(ValueError, match="span"):
        references.catenary(links, 0.1, span)


def test_an_elastic_catenary_that_cannot_hang():
    for links, span, compliance in ((1, 0.5, 1.0), (5, 0.1, 1.0), (5, 0.0, 1.0), (5, 0.5, 0.0)):
        with pytest.raises(ValueError, match="span"):
            closed_forms.elastic_catenary(links, 0.1, span, 1.0, compliance)


@pytest.mark.parametrize("compliance", [0.0, 0.01])
def test_a_hanging_chain_is_in_balance(compliance, rng):
    m = rng.uniform(0.1, 10.0, 7)
    x, tensions = references.hanging_chain(m, 0.3, compliance)
    np.testing.assert_allclose(x[:, [0, 2]], 0.0)
    np.testing.assert_array_equal(x[0], 0.0)
    np.testing.assert_allclose(-np.diff(x[:, 1]), 0.3 + compliance * tensions, rtol=1e-13)
    # What pulls particle i up less what pulls it down is its weight; below the last nothing pulls.
    np.testing.assert_allclose(tensions - np.r_[tensions[1:], 0.0], G * m, rtol=1e-12)


# Small oscillations.


def stiffness(tensions, length):
    """Sideways stiffness matrix [N/m] of particles 0..links, assembled link by link: tension over length."""
    matrix = np.zeros((len(tensions) + 1, len(tensions) + 1))
    for i, tension in enumerate(tensions):
        matrix[i : i + 2, i : i + 2] += tension / length * np.array([[1, -1], [-1, 1]])
    return matrix


@pytest.mark.parametrize("links", [1, 2, 10, 60])
def test_the_frequencies_of_a_hanging_chain(links):
    mass, a = 0.3, 0.25
    _, tensions = references.hanging_chain(np.full(links, mass), a)
    exact = np.sqrt(np.linalg.eigvalsh(stiffness(tensions, a)[1:, 1:] / mass))
    omega = closed_forms.chain_frequencies(links, a)
    np.testing.assert_allclose(omega, exact, rtol=1e-10)
    np.testing.assert_allclose(omega, np.sqrt(G / a * roots_laguerre(links)[0]), rtol=1e-11)


def test_the_frequencies_of_a_long_chain_tend_to_those_of_bessel():
    """omega_k = j_{0,k} sqrt(g/L)/2 in the continuum, which a chain nears like 1/links; 1000 links must be finite."""
    bessel = 0.5 * jn_zeros(0, 3) * np.sqrt(G)
    gaps = [1.0 - closed_forms.chain_frequencies(n, 1.0 / n)[:3] / bessel for n in (500, 1000)]
    np.testing.assert_allclose(gaps[0] / gaps[1], 2.0, rtol=0.01)
    assert 0.0 < gaps[1].max() < 1e-3


def test_a_chain_swings_in_its_first_mode():
    """Half a period of the motion itself turns a small u_j = L_j(xi) to its opposite, up to third order in it."""
    links, a, small = 4, 0.2, 1e-4
    omega = closed_forms.chain_frequencies(links, a)[0]
    mode = small * eval_laguerre(np.arange(links, -1, -1), omega**2 * a / G)
    x0 = np.zeros((links + 1, 3))
    x0[:, 0] = mode
    x0[1:, 1] = -np.cumsum(np.sqrt(a**2 - np.diff(mode) ** 2))
    x, _ = references.chain([np.pi / omega], x0, 0 * x0, np.r_[0.0, np.ones(links)], GRAVITY)
    np.testing.assert_allclose(x[0, :, 0], -mode, atol=100 * small**3 / a**2)


@pytest.mark.parametrize("links", [2, 9, 60])
def test_the_frequencies_of_a_taut_string(links):
    tension, a, mass = 7.0, 0.2, 0.05
    exact = np.sqrt(np.linalg.eigvalsh(stiffness(np.full(links, tension), a)[1:-1, 1:-1] / mass))
    np.testing.assert_allclose(closed_forms.string_frequencies(links, a, tension, mass), exact, rtol=1e-11)


# What the schemes themselves do.


def test_a_dumbbell_in_vectors_spins_down_alike():
    """The scheme in coordinates: predict, then put both particles at their distance again, by half the error each."""
    h, omega0, radius = 1 / 60, 2 * np.pi, 0.5
    ends = [np.exp(1j * (angle + np.array([0.0, np.pi]))) * radius for angle in (0.0, omega0 * h)]
    turned = [np.angle(ends[1][0] / ends[0][0]) / h]
    for _ in range(100):
        p = 2 * ends[-1] - ends[-2]
        d = p[1] - p[0]
        correction = 0.5 * (abs(d) - 2 * radius) * d / abs(d)
        ends.append(p + np.array([correction, -correction]))
        turned.append(np.angle(ends[-1][0] / ends[-2][0]) / h)
    np.testing.assert_allclose(closed_forms.dumbbell_spin(omega0, h, 100), turned, rtol=1e-12)


def test_a_dumbbell_spins_down_by_its_asymptotic_law():
    """omega0 / sqrt(1 + 2 h omega0^2 t), with a relative error of order (omega0 h)^2: slope 2 over four steps.

    The error is largest where 2 h omega0^2 t = e - 1, which every one of these runs passes.
    """
    omega0, end = 2 * np.pi, 20.0
    errors = []
    for steps in (600, 1200, 2400, 4800):
        h = end / steps
        law = omega0 / np.sqrt(1 + 2 * h * omega0**2 * h * np.arange(steps + 1))
        errors.append(np.abs(closed_forms.dumbbell_spin(omega0, h, steps) / law - 1).max())
    np.testing.assert_allclose(np.diff(np.log2(errors)), -2.0, atol=0.15)
    assert errors[-1] < 1e-3


def test_the_oscillator_solves_its_equation():
    mass, compliance, rest, times = 2.0, 0.01, 1.0, np.linspace(0, 3, 31)
    x = integrate(lambda s: np.array([s[1], -(s[0] - rest) / compliance / mass]), [1.25, 0.0], times)[:, 0]
    np.testing.assert_allclose(references.oscillator(times, 1.25, mass, compliance, rest), x, atol=1e-10)


@pytest.mark.parametrize("h", [1 / 600, 1 / 60, 1.0])
def test_the_implicit_oscillator_takes_implicit_euler_steps(h):
    """Each step solves x' = x + h v', v' = v - h (x' - rest) / (compliance mass) as a 2 x 2 system."""
    mass, compliance, rest, n = 2.0, 0.01, 1.0, np.arange(101)
    step = np.linalg.inv([[1.0, -h], [h / (compliance * mass), 1.0]])
    state, x = np.array([0.25, 0.0]), [1.25]
    for _ in n[1:]:
        state = step @ state
        x.append(rest + state[0])
    np.testing.assert_allclose(closed_forms.implicit_oscillator(n, h, 1.25, mass, compliance, rest), x, atol=1e-13)


def test_the_implicit_oscillator_tends_to_the_continuous_one():
    """First order: half the step, half the error."""
    errors = []
    for n in (500, 1000, 2000, 4000):
        x = closed_forms.implicit_oscillator(n, 1.0 / n, 1.25, 2.0, 0.02, 1.0)
        errors.append(abs(x - references.oscillator(1.0, 1.25, 2.0, 0.02, 1.0)))
    np.testing.assert_allclose(np.diff(np.log2(errors)), -1.0, atol=0.1)
