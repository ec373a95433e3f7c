"""Bending in every method and integrator, what is refused, measured and told; drag."""

import re

import numpy as np
import pytest
from rods import G, rod

import pbd_warp as pbd
from pbd_warp.step.integrators import INTEGRATORS


def fingerprint(sim):
    return {name: array.numpy().tobytes() for name, array in sim._context.arrays.items()}


def bent(links=10):
    t = np.linspace(0.0, 1.0, links + 1)
    return np.stack([t, 0.1 * np.sin(3.0 * t), 0.05 * np.cos(4.0 * t)], axis=1)


shapes = pytest.mark.parametrize("rest_shape", ["straight", "as_built"])


@shapes
@pytest.mark.parametrize("compliance", [0.0, 1e-5])
@pytest.mark.parametrize("integrator", ["midpoint", "midpoint4"])
def test_energy_and_momenta_are_kept_to_round_off(integrator, rest_shape, compliance):
    """A free rod, thrown and bent, for a second."""
    model = rod(bent(), 1.0, 0.05, pinned=(), gravity=(0, 0, 0), rest_shape=rest_shape, compliance=compliance)
    t = np.linspace(0.0, 1.0, 11)
    model.v[:] = np.stack([0 * t, 2.0 * np.sin(5.0 * t), 3.0 * np.cos(4.0 * t)], axis=1)
    sim = pbd.Simulation(model, method=pbd.Direct(), integrator=integrator, substeps=4)
    sim.step()  # whose velocities are such as the links allow
    start, most = pbd.measure(sim), 0.0
    for _ in range(59):
        sim.step()
        now = pbd.measure(sim)
        assert abs(now.energy - start.energy) < 1e-11 * start.energy
        np.testing.assert_allclose(now.momentum, start.momentum, atol=1e-12)
        np.testing.assert_allclose(now.angular_momentum, start.angular_momentum, atol=1e-12)
        most = max(most, now.bending)
    assert most > 0.01 * start.energy


@shapes
@pytest.mark.parametrize("integrator", ["pbd", "bdf2", "midpoint"])
def test_sweeps_come_to_what_direct_finds(integrator, rest_shape):
    """But for forces along the gradients of iterates on the way, as of distances: some 1e-4 of the move."""

    def after(method):
        model = rod(bent(), 0.1, 1e-3, rest_shape=rest_shape)
        sim = pbd.Simulation(model, method=method, integrator=integrator, substeps=4)
        for _ in range(8):
            sim.step()
        return sim.positions

    exact = after(pbd.Direct())
    assert np.abs(exact - bent()).max() > 0.05
    for method in (pbd.GaussSeidel(4000, tolerance=1e-11), pbd.Jacobi(12000, tolerance=1e-11)):
        assert np.abs(after(method) - exact).max() < 1e-4


def test_few_sweeps_are_softer():
    """What XPBD leaves when it is stopped early is a softer rod: the more so the fewer sweeps; Direct is not."""

    def sinks(method):
        sim = pbd.Simulation(rod(np.linspace([0.0, 0, 0], [1, 0, 0], 21), 0.1, 1.0), method=method, drag=5.0)
        for _ in range(60):
            sim.step()
        return -sim.positions[-1, 1]

    few, many, direct = (sinks(method) for method in (pbd.GaussSeidel(50), pbd.GaussSeidel(2000), pbd.Direct()))
    assert few > 1.5 * many > 1.01 * direct
    assert direct == pytest.approx(0.1 * G / 8.0, rel=0.1)


def test_without_bending_nothing_is_there():
    straight = np.linspace([0.0, 0, 0], [1, 0, 0], 6)
    for method in (pbd.Jacobi(), pbd.GaussSeidel(), pbd.Direct()):
        sim = pbd.Simulation(rod(straight, 1.0, 0.0), method=method)
        assert not [name for name in (*sim.memory, *sim.passes) if "bend" in name]
        assert [name for name in pbd.Simulation(rod(straight, 1.0, 1.0), method=method).memory if "bend" in name]


@pytest.mark.parametrize("method", [pbd.Jacobi(8), pbd.GaussSeidel(8)])
def test_sweeps_make_the_same_frames_fused_and_launched(method):
    one, other = (pbd.Simulation(rod(bent(), 0.1, 1e-3), method=method, capture=c) for c in (True, False))
    assert one.fused
    assert not other.fused
    for sim in (one, other):
        for _ in range(5):
            sim.step()
    assert fingerprint(one) == fingerprint(other)


def test_a_clamp_that_is_turned_turns_the_rod():
    """Two fixed particles that are led; no gravity: at rest the rod is straight, and points where they do."""
    sim = pbd.Simulation(rod(np.linspace([0.0, 0, 0], [1, 0, 0], 11), 0.1, 0.5, gravity=(0, 0, 0)),
                         method=pbd.Direct(), substeps=4, drag=5.0)  # fmt: skip
    for angle in np.linspace(0.0, 1.0, 60):
        sim.lead([0, 1], [[0, 0, 0], [0.1 * np.cos(angle), 0.1 * np.sin(angle), 0]])
        sim.step()
    for _ in range(300):
        sim.step()
    np.testing.assert_allclose(sim.positions[-1], [np.cos(1.0), np.sin(1.0), 0], atol=1e-6)


@pytest.mark.parametrize("kind", ["straight", "folded", "coincident"])
@pytest.mark.parametrize("method", [pbd.Jacobi(), pbd.GaussSeidel(), pbd.Direct()])
def test_singular_shapes_are_finite_and_told(kind, method):
    x = {
        "straight": [(0, 0, 0), (1, 0, 0), (2, 0, 0)],
        "folded": [(0, 0, 0), (1, 0, 0), (0, 1e-9, 0)],
        "coincident": [(0, 0, 0), (0, 0, 0), (0, 0, 0)],
    }[kind]
    builder = pbd.ModelBuilder()
    builder.add_particles(x, mass=[0.0, 1.0, 1.0])
    builder.add_distances([(0, 1), (1, 2)], rest_length=1.0)
    builder.add_bending(0, 1, 2, 0.5)
    sim = pbd.Simulation(builder.finalize(dtype="float64"), method=method, substeps=4, on_failure="continue")
    told = [warning for warning in sim.check() if warning.test == "bending"]
    assert bool(told) == (kind != "straight")
    assert all("particle 1" in str(warning) for warning in told)
    for _ in range(3):
        sim.step()
    assert np.isfinite(sim.positions).all()


def test_clamps_carry_the_moment_of_the_weight():
    """And reactions the weight itself: of a rod at rest."""
    sim = pbd.Simulation(rod(np.linspace([0.0, 0, 0], [1, 0, 0], 11), 0.1, 5.0), method=pbd.Direct(), dt=1.0)
    for _ in range(30):
        sim.step()
    x, mass = sim.positions, sim.model.mass
    forces = sim.forces
    middle = 0.5 * (x[0] + x[1])
    np.testing.assert_allclose(forces.reaction[:2].sum(axis=0), [0, mass.sum() * G, 0], atol=1e-6)
    moment = np.cross(x - middle, mass[:, None] * [0, -G, 0]).sum(axis=0)
    np.testing.assert_allclose(forces.moment[0], -moment, rtol=1e-6)
    np.testing.assert_array_equal(forces.moment[1:], 0.0)


BAD = {
    "negative": (lambda b: b.add_rope(np.eye(3), bending=-1.0), "bending must be a finite number of at least 0"),
    "nan": (lambda b: b.add_rope(np.eye(3), bending=np.nan), "bending must be a finite number of at least 0"),
    "no path": (lambda b: (b.add_particles(np.eye(3)), b.add_bending(0, 1, 2, 1.0)), "needs a path"),
    "twice": (lambda b: (b.add_rope(np.eye(3)), b.add_bending(0, 1, 0, 1.0)), "needs a path"),
    "zero": (lambda b: (b.add_rope(np.eye(3)), b.add_bending(0, 1, 2, 0.0)), "must be above 0"),
    "shape": (lambda b: b.add_rope(np.eye(3), bending=1.0, rest_shape="curly"), "unknown rest_shape 'curly'"),
    "folded": (
        lambda b: b.add_rope([(0, 0, 0), (1, 0, 0), (0, 0, 0)], bending=1.0, rest_shape="as_built"),
        "fold back",
    ),
    "radius": (lambda b: pbd.RoundSection(0.0, 1e9, 1000.0), "radius of a section must be a finite number above 0"),
    "modulus": (lambda b: pbd.RoundSection(0.1, -1e9, 1000.0), "youngs_modulus of a section must be"),
    "both": (lambda b: b.add_rope(np.eye(3), mass=1.0, section=pbd.RoundSection(0.1, 1e9, 1e3)), "gives its mass"),
    "dop853": (lambda b: pbd.Simulation(rod(bent(), 1.0, 1.0), integrator="dop853"), "does not model bending"),
    "valence": (
        lambda b: pbd.Simulation(rod(bent(), 1.0, 1.0), method=pbd.Jacobi(averaging="valence")),
        "bending needs",
    ),
    "drag": (lambda b: pbd.Settings(drag=-1.0), "drag must be a finite number of at least 0"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_sentence(case):
    cause, message = BAD[case]
    with pytest.raises(pbd.InputError, match=re.escape(message)) as caught:
        cause(pbd.ModelBuilder())
    assert "\n" not in str(caught.value)


def test_a_section_gives_mass_compliance_and_bending():
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0), (3, 0, 0)], pinned=(), section=pbd.RoundSection(0.01, 2e9, 1000.0))
    model = builder.finalize(dtype="float64")
    area = np.pi * 1e-4
    np.testing.assert_allclose(model.mass, 1000.0 * area * np.array([0.5, 1.5, 1.0]))
    np.testing.assert_allclose(model.distance.compliance, np.array([1.0, 2.0]) / (2e9 * area))
    np.testing.assert_allclose(model.bending.stiffness, 2e9 * np.pi * 1e-8 / 4.0)
    np.testing.assert_allclose(model.bending.length, 1.5)
    np.testing.assert_array_equal(model.radius, 0.01)


def test_a_checkpoint_goes_on_to_the_last_bit(tmp_path):
    one = pbd.Simulation(rod(bent(), 0.1, 1e-3, rest_shape="as_built"), method=pbd.Direct())
    one.step(frames=3)
    one.save(tmp_path / "c.npz")
    other = pbd.Simulation.load(tmp_path / "c.npz")
    for sim in (one, other):
        sim.step(frames=3)
    assert fingerprint(one) == fingerprint(other)


@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_drag_keeps_the_order(integrator):
    """A stone thrown in air, drag c: x = v (1 - e^(-c t)) / c, y = -g t / c + g (1 - e^(-c t)) / c^2."""
    c, t, errors = 2.0, 1.0, []
    gone = (1.0 - np.exp(-c * t)) / c
    exact = np.array([3.0 * gone, -G * (t - gone) / c, 0.0])
    for substeps in (8, 16):
        builder = pbd.ModelBuilder()
        builder.add_particle((0, 0, 0), velocity=(3, 0, 0), mass=0.3)
        model = builder.finalize(dtype="float64")
        sim = pbd.Simulation(model, integrator=integrator, substeps=substeps, drag=c, dt=0.5)
        sim.step(frames=2)
        errors.append(np.linalg.norm(sim.positions[0] - exact))
    assert np.log2(errors[0] / errors[1]) > INTEGRATORS[integrator].order - 0.1


def test_a_groom_keeps_its_style():
    """A lock comes to rest where a rod of its natural curvature does (elastica)."""
    from pbd_warp.accuracy import rods
    from pbd_warp.scenes import groom

    scene = pbd.load_scene("groom")
    model = scene.builder.finalize(dtype="float64")
    sim = pbd.Simulation(model, scene.settings.changed(dt=1.0, drag=0.0))
    for _ in range(40):
        sim.step()
    links = len(model.ropes[0]) - 1
    section = pbd.RoundSection(groom.RADIUS, 4e9, 1300.0)
    s = rods.clamped(links, groom.LENGTH)
    weight = (0.0, -G * 1300.0 * section.area)
    exact = rods.elastica(s, groom.LENGTH, section.bending, weight=weight, curvature=groom.CURVATURE, tip=(-1.5, 3.0))
    first = sim.positions[: links + 1]
    assert np.linalg.norm(exact[-1] - model.x[links]) > 0.01, "it has sunk"
    np.testing.assert_allclose(first[2:], exact[2:], atol=4e-3 * groom.LENGTH)


@pytest.mark.parametrize("name", ["cantilever", "elastica", "column", "cable"])
def test_scenes_of_rods_stay_where_they_are(name):
    scene = pbd.load_scene(name)
    sim = pbd.Simulation(scene.builder.finalize(dtype="float64"), scene.settings)
    for _ in range(60):
        sim.step()
    assert np.abs(sim.positions - scene.reference(1.0)).max() < 1e-3
    without = pbd.Simulation(replace_bending(scene), scene.settings.changed(on_failure="continue"))
    for _ in range(60):
        without.step()
    assert np.abs(without.positions - scene.reference(1.0)).max() > 0.05


def replace_bending(scene):
    from dataclasses import replace

    model = scene.builder.finalize(dtype="float64")
    return replace(model, bending=model.bending.subset(np.zeros(0, int)))
