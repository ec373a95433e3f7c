"""Compliance: springs, tensions, catenaries."""

import closed_forms
import numpy as np
import pytest
from models import state
from solving import EPS, converged, rope_between, run

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.step.methods.gauss_seidel import colours

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
    exact = closed_forms.implicit_oscillator(n, h, 1.25, mass, compliance, 1.0)
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
        lam = -sim._loop.solver.tension() * sim.settings.step_dt**2
    elif name == "jacobi":
        lam = sim._context.arrays["distance.lam"].numpy()
    else:
        lam = np.zeros(10)
        for colour, group in enumerate(colours(sim.model.distance.edge)):
            lam[group] = sim._context.arrays[f"distance.{colour}.lam"].numpy()
    np.testing.assert_allclose(-lam / sim.settings.step_dt**2, tension, rtol=rtol)
    stretch = np.linalg.norm(np.diff(state(sim)[0], axis=0), axis=1) - 0.1
    np.testing.assert_allclose(stretch, compliance * tension, rtol=rtol)


def elastic_catenary(start=(0, 0, 0)):
    """A model of 12 springs between two fixed ends, moved by `start` from where it rests; and where that is."""
    links, length, compliance = 12, 0.1, 1e-3
    x, tension = closed_forms.elastic_catenary(links, length, 0.9, 0.2, compliance)
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
