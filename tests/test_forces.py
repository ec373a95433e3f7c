"""Tensions, reactions and contact forces, against statics."""

import closed_forms
import numpy as np
import pytest
from models import rope_model, state
from test_direct_contacts import capstan

import pbd_warp as pbd
from pbd_warp.accuracy import references

G = 9.81
STAGES = {"pbd": 1, "bdf2": 1, "midpoint": 1, "midpoint4": 5}
every_integrator = pytest.mark.parametrize("integrator", STAGES)


def at_rest(positions, masses, integrator, rest_length=None, compliance=0.0, **settings):
    """A chain that starts in equilibrium, after a frame in which nothing is to move."""
    builder = pbd.ModelBuilder()
    builder.add_particles(positions, mass=masses)
    edges = [(k, k + 1) for k in range(len(positions) - 1)]
    builder.add_distances(edges, rest_length=rest_length, compliance=compliance)
    sim = pbd.Simulation(builder.finalize(dtype="float64"), method="direct", integrator=integrator, **settings)
    sim.step()
    np.testing.assert_allclose(state(sim)[0], positions, atol=1e-9)
    return sim


@every_integrator
@pytest.mark.parametrize("substeps", [1, 3])
def test_a_hanging_chain_carries_what_hangs_below(integrator, substeps):
    masses = np.linspace(0.1, 2.0, 10)
    x, tension = references.hanging_chain(masses, 0.1)
    sim = at_rest(x, np.r_[0.0, masses], integrator, substeps=substeps)
    np.testing.assert_allclose(sim.tension, tension, rtol=1e-9)
    np.testing.assert_allclose(sim.reaction[0], (0.0, G * masses.sum(), 0.0), atol=1e-8)
    np.testing.assert_array_equal(sim.reaction[1:], 0.0)
    assert np.array_equal(pbd.measure(sim).forces.tension, sim.tension)


@every_integrator
def test_a_catenary_pulls_along_itself(integrator):
    """T = sqrt(H^2 + V_i^2), V_i - V_{i-1} = m g: from the angles alone."""
    links, mass = 20, 0.1
    x = references.catenary(links, 1.0 / links, 0.7)
    sim = at_rest(x, [0.0, *[mass] * (links - 1), 0.0], integrator)
    d = np.diff(x, axis=0)
    slope = d[:, 1] / d[:, 0]
    horizontal = mass * G / np.diff(slope)  # between neighbours, the same everywhere
    np.testing.assert_allclose(horizontal, horizontal.mean(), rtol=1e-9)
    expected = horizontal.mean() * np.sqrt(1.0 + slope**2)
    np.testing.assert_allclose(sim.tension, expected, rtol=1e-8)
    ends = sim.reaction[[0, -1]]
    np.testing.assert_allclose(ends.sum(axis=0), (0.0, (links - 1) * mass * G, 0.0), atol=1e-7)
    np.testing.assert_allclose(ends[0, 0], -horizontal.mean(), rtol=1e-8)


@every_integrator
def test_an_elastic_catenary(integrator):
    links, mass, compliance = 12, 0.1, 1e-3
    x, tension = closed_forms.elastic_catenary(links, 1.0 / links, 0.8, mass, compliance)
    masses = [0.0, *[mass] * (links - 1), 0.0]
    sim = at_rest(x, masses, integrator, rest_length=1.0 / links, compliance=compliance)
    np.testing.assert_allclose(sim.tension, tension, rtol=1e-8)


def test_a_point_constraint_holds_what_a_fixed_particle_would():
    builder = pbd.ModelBuilder()
    rope = builder.add_rope(np.linspace([0, 0, 0], [0, -1, 0], 6), mass=[0.3] * 6, pinned=())
    builder.add_point(rope[0])
    sim = pbd.Simulation(builder.finalize(dtype="float64"), method="direct")
    sim.step()
    np.testing.assert_allclose(sim.reaction[0], (0.0, 6 * 0.3 * G, 0.0), atol=1e-8)  # its own weight too


def test_a_grabbed_particle_is_held():
    sim = pbd.Simulation(rope_model(2, pinned=(), gravity=(0, 0, 0)), method="direct")
    mass = 1.0 / sim.model.w[1]
    sim.grab(0)
    sim.move_to((-0.001, 0.0, 0.0))
    sim.step()
    # The other end comes along, from rest to 1 mm a frame in one frame.
    force = mass * 0.001 / sim.dt**2
    np.testing.assert_allclose(sim.tension, [force], rtol=1e-9)
    np.testing.assert_allclose(sim.reaction[0], (-force, 0.0, 0.0), rtol=1e-9, atol=1e-12)


def test_the_ground_carries_the_weight():
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0, 0.01, 0], [1, 0.01, 0], 5), mass=[0.2] * 5, pinned=(), radius=0.01)
    builder.add_plane((0, 0, 0), (0, 1, 0))
    sim = pbd.Simulation(builder.finalize(dtype="float64"), method="direct")
    for _ in range(3):
        sim.step()
    np.testing.assert_allclose(sim.forces.contact, [(0.0, 0.2 * G, 0.0)] * 5, atol=1e-7)
    np.testing.assert_array_equal(sim.reaction, 0.0)


def test_what_keeps_no_multipliers_says_so():
    sim = pbd.Simulation(rope_model(3), method="jacobi")
    sim.step()
    assert pbd.measure(sim).forces is None
    with pytest.raises(pbd.InputError, match="forces are known with method 'direct', not with Jacobi"):
        _ = sim.tension


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.8])
def test_tension_grows_around_a_ball_as_the_capstan_equation_says(friction):
    """Of a polygon that slides: T2/T1 = (1 + mu tan(turn/2)) / (1 - mu tan(turn/2)) at every particle that touches."""
    rope = 0.002  # kg, beside loads of 1 kg and more: its inertia is what the equation leaves out
    model, _ = capstan(friction, 1.1, "float64", masses=rope)
    sim = pbd.Simulation(model, method="direct", substeps=4)
    for _ in range(20):
        sim.step()
    tension, x = sim.tension, state(sim)[0]
    d = np.diff(x, axis=0)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    turn = np.arccos(np.clip(np.sum(d[1:] * d[:-1], axis=1), -1.0, 1.0))
    touches = np.linalg.norm(sim.forces.contact[1:-1], axis=1) > 1e-3
    assert touches.sum() > 40
    ratio = np.ones(len(turn))
    grip = friction * np.tan(turn[touches] / 2.0)
    ratio[touches] = (1.0 + grip) / (1.0 - grip)
    expected = tension[0] * np.cumprod(np.r_[1.0, ratio])
    np.testing.assert_allclose(tension, expected, rtol=2.0 * rope)
    assert tension[-1] / tension[0] == pytest.approx(np.exp(friction * turn.sum()), rel=0.01)
