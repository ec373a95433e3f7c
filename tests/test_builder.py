"""Models as they are built, and one clear sentence for every input that makes no sense."""

import re

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.model.graph import components

NAN, INF = float("nan"), float("inf")


def builder_of(n=3, **kwargs):
    builder = pbd.ModelBuilder()
    builder.add_particles(np.eye(3)[:n], **kwargs)
    return builder


def simulate(**settings):
    return pbd.Simulation(builder_of().finalize(), **settings)


BAD = {
    "gravity": (lambda: pbd.ModelBuilder(gravity=(0, NAN, 0)), "gravity must be finite"),
    "position nan": (lambda: builder_of().add_particle((0, NAN, 0)), "position must be finite"),
    "position inf": (lambda: builder_of().add_particle((0, INF, 0)), "position must be finite"),
    "positions": (lambda: builder_of().add_particles([(0, 0, 0), (0, INF, 0)]), "positions .* number 1 is (0, inf, 0)"),
    "flat": (lambda: builder_of().add_particles([(0, 0)]), "shape [n, 3], not [1, 2]"),
    "text": (lambda: builder_of().add_particle("abc"), "must be numbers in threes"),
    "velocity": (lambda: builder_of().add_particle((0, 0, 0), velocity=(NAN, 0, 0)), "velocity must be finite"),
    "velocities": (lambda: builder_of(velocity=np.zeros((2, 3))), "velocity must be one vector or 3"),
    "mass": (lambda: builder_of().add_particle((0, 0, 0), mass=-1), "mass must be a finite number of at least 0"),
    "mass nan": (lambda: builder_of().add_particle((0, 0, 0), mass=NAN), "mass must be"),
    "masses": (lambda: builder_of(mass=[1, 2, -3]), "mass must be .* not -3 (number 2)"),
    "mass count": (lambda: builder_of(mass=[1, 2]), "mass must be one number or 3"),
    "moving fixed": (lambda: builder_of(mass=0, velocity=(1, 0, 0)), "particle 0 is fixed (mass 0)"),
    "radius": (lambda: builder_of(radius=-0.1), "radius must be"),
    "rest length": (lambda: builder_of().add_distance(0, 1, rest_length=-1), "rest_length must be"),
    "compliance": (lambda: builder_of().add_distance(0, 1, compliance=-1e-9), "compliance must be"),
    "stiffness high": (lambda: builder_of().add_distance(0, 1, stiffness=1.5), "stiffness must be .* in 0..1, not 1.5"),
    "stiffness low": (lambda: builder_of().add_point(0, stiffness=-0.1), "stiffness must be"),
    "both": (lambda: builder_of().add_distance(0, 1, stiffness=0.5, compliance=1), "give it one of the two"),
    "index": (lambda: builder_of().add_distance(0, 3), "names particle 3, but there are 3 (0 to 2)"),
    "index low": (lambda: builder_of().add_distance(-1, 0), "names particle -1"),
    "index float": (lambda: builder_of().add_distances([(0.0, 1.0)]), "must be particle indices"),
    "self": (lambda: builder_of().add_distance(1, 1), "joins particle 1 to itself"),
    "point index": (lambda: builder_of().add_point(7), "point names particle 7"),
    "target": (lambda: builder_of().add_point(0, target=(0, 0, NAN)), "target must be finite"),
    "rope": (lambda: builder_of().add_rope([(0, 0, 0)]), "at least 2 particles, not 1"),
    "pinned": (lambda: builder_of().add_rope(np.eye(3), pinned=(5,)), "pinned names particle 5 of a graph of 3"),
    "graph edge": (lambda: builder_of().add_graph(np.eye(3), [(0, 3)]), "edges names particle 3"),
    "normal": (lambda: builder_of().add_plane((0, 0, 0), (0, 0, 0)), "normal must not be (0, 0, 0)"),
    "sphere": (lambda: builder_of().add_sphere((0, 0, 0), 0.0), "radius must be a finite number above 0"),
    "friction": (lambda: builder_of().enable_contacts(friction=-1), "friction must be"),
    "restitution": (lambda: builder_of().add_plane((0, 0, 0), (0, 1, 0), restitution=2), "restitution must be"),
    "no radius": (lambda: with_contacts().finalize(), "every radius is 0"),
    "empty": (lambda: pbd.ModelBuilder().finalize(), "has no particles"),
    "dtype": (lambda: builder_of().finalize(dtype="float16"), "unknown dtype 'float16': there is float32, float64"),
    "device": (lambda: builder_of().finalize(device="cpv"), "unknown device 'cpv': there is .*did you mean"),
    "float32": (lambda: too_far().finalize(), "particle 3 is too large .* use dtype 'float64'"),
    "dt": (lambda: simulate(dt=0), "dt must be a finite number in 1e-09..1e+06, not 0"),
    "dt nan": (lambda: simulate(dt=NAN), "dt must be"),
    "substeps": (lambda: simulate(substeps=0), "substeps must be at least 1, not 0"),
    "substeps float": (lambda: simulate(substeps=1.5), "substeps must be a whole number"),
    "damping": (lambda: simulate(damping=1.1), "damping must be"),
    "integrator": (lambda: simulate(integrator="pdb"), "unknown integrator 'pdb': there is .*did you mean 'pbd'"),
    "contacts": (lambda: simulate(max_contacts=0), "max_contacts must be at least 1"),
    "iterations": (lambda: pbd.Jacobi(0), "iterations must be at least 1"),
    "relaxation": (lambda: pbd.Jacobi(relaxation=2.0), "relaxation must be in (0, 2) with mass splitting"),
    "relaxation 0": (lambda: pbd.Jacobi(relaxation=0.0), "relaxation must be"),
    "averaging": (lambda: pbd.Jacobi(averaging="mass"), "unknown averaging 'mass'"),
    "valence": (lambda: soft_valence(), "compliance needs averaging"),
    "grab": (lambda: simulate().grab(3), "grab names particle 3"),
    "move": (lambda: simulate().move_to((0, 0, 0)), "call grab(particle) first"),
    "move nan": (lambda: grabbed().move_to((0, NAN, 0)), "position must be finite"),
}


def with_contacts():
    builder = builder_of()
    builder.enable_contacts()
    return builder


def too_far():
    builder = builder_of()
    builder.add_particle((1e39, 0, 0))
    return builder


def soft_valence():
    builder = builder_of()
    builder.add_distance(0, 1, compliance=1e-3)
    return pbd.Simulation(builder.finalize(), method=pbd.Jacobi(averaging="valence"))


def grabbed():
    sim = simulate()
    sim.grab(1)
    return sim


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_clear_sentence(case):
    cause, message = BAD[case]
    pattern = ".*".join(re.escape(part) for part in message.split(".*"))
    with pytest.raises(pbd.InputError, match=pattern) as caught:
        cause()
    assert "\n" not in str(caught.value)


def test_a_rope_shares_its_mass_among_its_particles_by_length():
    """Each has half of its two links; links without length count alike."""
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0), (4, 0, 0)], mass=8.0, pinned=(0,))
    builder.add_rope(np.eye(3), mass=[1, 2, 4], pinned=(-1,))
    builder.add_rope([(0, 0, 0), (1, 0, 0), (2, 0, 0)], mass=8.0, pinned=(), rest_length=[3.0, 1.0])
    builder.add_rope(np.eye(3), mass=6.0, pinned=(), rest_length=0.0)
    model = builder.finalize()
    np.testing.assert_allclose(model.mass, [0, 4, 3, 1, 2, 0, 3, 4, 1, 2, 2, 2])
    np.testing.assert_array_equal(model.distance.rest_length[4:], [3, 1, 0, 0])


def test_rest_length_and_target_default_to_what_is_there():
    builder = pbd.ModelBuilder()
    builder.add_particles([(0, 0, 0), (3, 4, 0)])
    builder.add_distance(0, 1)
    builder.add_point(1)
    model = builder.finalize()
    np.testing.assert_array_equal(model.distance.rest_length, [5])
    np.testing.assert_array_equal(model.point.target, [(3, 4, 0)])


def test_graphs_are_numbered_on_and_remember_their_ropes():
    builder = pbd.ModelBuilder()
    assert builder.add_particle((0, 0, 0)) == 0
    assert builder.add_rope(np.eye(3)) == range(1, 4)
    assert builder.add_graph(np.eye(3), [(0, 2)]) == range(4, 7)
    model = builder.finalize()
    np.testing.assert_array_equal(model.distance.edge, [(1, 2), (2, 3), (4, 6)])
    np.testing.assert_array_equal(model.ropes, [(1, 2, 3)])
    np.testing.assert_array_equal(model.component, [0, 1, 1, 1, 2, 3, 2])


def test_components_against_scipy(rng):
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    for n, m in ((1, 0), (40, 25), (400, 380), (1000, 999)):
        edge = rng.integers(0, n, (m, 2))
        graph = coo_array((np.ones(m), edge.T), shape=(n, n))
        expected = connected_components(graph, directed=False)[1]
        np.testing.assert_array_equal(components(edge, n), expected)
    chain = np.stack([np.arange(99_999), np.arange(1, 100_000)], axis=1)
    assert not components(rng.permutation(chain), 100_000).any()
