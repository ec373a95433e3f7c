"""Particles and ropes on shapes at rest and in motion, against what one can work out by hand."""

import numpy as np
import pytest
from meshes import ball, cuboid, sheet, torus

import pbd_warp as pbd

METHODS = {"direct": pbd.Direct(), "jacobi": pbd.Jacobi(30), "gauss-seidel": pbd.GaussSeidel(20)}
EACH = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS)


def one_particle(add, position, velocity=(0, 0, 0), radius=0.05, gravity=(0, -9.81, 0), dtype="float64", **settings):
    builder = pbd.ModelBuilder(gravity=gravity)
    builder.add_particle(position, velocity, radius=radius)
    add(builder)
    return pbd.Simulation(builder.finalize(dtype=dtype), **settings)


def tilted(angle):
    return np.array([0.0, 0.0, -angle])


PLANKS = {
    "plane": lambda b, a, mu: b.add_plane((0, 0, 0), (np.sin(a), np.cos(a), 0), friction=mu),
    "box": lambda b, a, mu: b.add_box((-np.sin(a), -np.cos(a), 0), (40, 2, 4), tilted(a), friction=mu),
    "mesh box": lambda b, a, mu: b.add_mesh(*cuboid((40, 2, 4)), (-np.sin(a), -np.cos(a), 0), tilted(a), friction=mu),
    "sheet": lambda b, a, mu: b.add_mesh(*sheet(40.0, 3), rotation=tilted(a), friction=mu),
}


@EACH
@pytest.mark.parametrize("plank", PLANKS)
@pytest.mark.parametrize("mu", [0.0, 0.3, 0.7])
def test_an_incline_is_an_incline_whatever_it_is_made_of(plank, mu, method):
    angle, frames = 0.5, 60
    sim = one_particle(
        lambda b: PLANKS[plank](b, angle, mu),
        0.05 * np.array([np.sin(angle), np.cos(angle), 0])
        + (0.1, 0, 0.2) * np.array([np.cos(angle), 0, 1])
        - (0, 0.1 * np.sin(angle), 0),
        substeps=4,
        method=method,
    )
    start = sim.positions[0]
    for _ in range(frames):
        sim.step()
    steps, h = 4 * frames, 1.0 / 240.0
    pull = max(9.81 * (np.sin(angle) - mu * np.cos(angle)), 0.0)
    way = pull * h * h * steps * (steps + 1) / 2  # of symplectic Euler
    along = (sim.positions[0] - start) @ (np.cos(angle), -np.sin(angle), 0)
    assert along == pytest.approx(way, rel=1e-5, abs=1e-6)
    assert np.linalg.norm(sim.positions[0] - start) == pytest.approx(way, rel=1e-5, abs=1e-6)


STANDS = {
    "box": lambda b, mu: b.add_box((0, -1, 0), (20, 2, 20), friction=mu),
    "plane": lambda b, mu: b.add_plane((0, 0, 0), (0, 1, 0), friction=mu),
    "mesh": lambda b, mu: b.add_mesh(*cuboid((20, 2, 20)), (0, -1, 0), friction=mu),
    "sheet": lambda b, mu: b.add_mesh(*sheet(20.0), friction=mu),
}


@EACH
@pytest.mark.parametrize("stand", STANDS)
def test_what_moves_takes_along_what_lies_on_it(stand, method):
    """Friction brings it to the speed of the ground: mu g t, then no more."""

    def add(builder):
        builder.let_collider_move(STANDS[stand](builder, 0.4), velocity=(1.0, 0, 0))

    sim = one_particle(add, (0.1, 0.05, 0.2), substeps=4, method=method)
    sim.step(frames=9)
    assert sim.velocities[0, 0] == pytest.approx(0.4 * 9.81 * 9 / 60, rel=1e-4)
    sim.step(frames=51)
    np.testing.assert_allclose(sim.velocities[0], [1.0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(sim.collider_places[0][0] - sim.model.colliders.centre[0], [1.0, 0, 0], atol=1e-9)


@EACH
def test_a_turning_table_carries_round(method):
    """What lies within mu g / omega^2 of the axis turns with it; a step goes along its chord, less than a circle's."""

    def add(builder):
        table = builder.add_cylinder((0, -0.2, 0), (0, 0, 0), 1.0, friction=0.8)
        builder.let_collider_move(table, angular_velocity=(0, 2.0, 0))

    sim = one_particle(add, (0.3, 0.05, 0), (0, 0, -0.6), substeps=8, method=method)
    sim.step(frames=60)
    x = sim.positions[0]
    assert np.hypot(x[0], x[2]) == pytest.approx(0.3, rel=0.01)
    assert np.arctan2(-x[2], x[0]) == pytest.approx(2.0, abs=0.02)


def test_a_wall_that_comes_pushes_and_does_not_overlap():
    def add(builder):
        builder.let_collider_move(builder.add_box((-1, 0, 0), (1, 1, 1)), velocity=(3.0, 0, 0))

    sim = one_particle(add, (0, 0, 0), gravity=(0, 0, 0), substeps=2, method=pbd.Direct())
    deepest = 0.0
    for _ in range(30):
        sim.step()
        deepest = max(deepest, sim.collider_overlaps[0].max())
    assert deepest < 1e-9
    np.testing.assert_allclose(sim.positions[0], [-1 + 1.5 + 0.5 + 0.05, 0, 0], atol=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_racket_gives_twice_its_speed(e):
    def add(builder):
        builder.let_collider_move(builder.add_box((-1, 0, 0), (1, 4, 4), restitution=e), velocity=(3.0, 0, 0))

    sim = one_particle(add, (0, 0, 0), (-1.0, 0, 0), gravity=(0, 0, 0), substeps=4)
    sim.step(frames=30)
    np.testing.assert_allclose(sim.velocities[0], [3.0 + e * 4.0, 0, 0], atol=1e-9)


CLOSED = {
    "box": lambda b, mu=0.0: b.add_box((0, 0, 0), (1, 0.8, 1.2), (0.3, 0.2, 0.1), friction=mu),
    "capsule": lambda b, mu=0.0: b.add_capsule((-0.5, 0, 0), (0.5, 0.1, 0), 0.4, friction=mu),
    "cylinder": lambda b, mu=0.0: b.add_cylinder((-0.5, 0, 0), (0.5, 0.1, 0), 0.4, friction=mu),
    "cone": lambda b, mu=0.0: b.add_cone((0, -0.5, 0), (0, 0.5, 0), 0.6, 0.2, friction=mu),
    "sphere": lambda b, mu=0.0: b.let_collider_move(b.add_sphere((0, 0, 0), 0.5, mu)),
    "ball": lambda b, mu=0.0: b.add_mesh(*ball(16, 0.5), friction=mu),
    "torus": lambda b, mu=0.0: b.add_mesh(*torus(0.4, 0.2), friction=mu),
}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("shape", CLOSED)
def test_no_bullet_goes_through(shape, dtype, rng):
    """Ten times its size in a step, at a wall: in the end it is outside, where it came from."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    away = rng.normal(size=(200, 3))
    away *= 2.0 / np.linalg.norm(away, axis=1)[:, None]
    aim = rng.uniform(-0.1, 0.1, (200, 3))
    builder.add_particles(away, (aim - away) * 20.0, radius=0.02)
    CLOSED[shape](builder, 100.0)
    sim = pbd.Simulation(builder.finalize(dtype=dtype), substeps=1)
    for _ in range(8):
        sim.step()
        # Concave: a step meets one face, and may end in another one, by less than its radius.
        assert sim.collider_overlaps[0].max() < (0.02 if shape == "torus" else 1e-3)
    assert sim.collider_overlaps[0].max() < 1e-3
    if shape != "torus":
        assert np.einsum("ij,ij->i", sim.positions, away).min() > 0.0, "on the side that it came from"


@pytest.mark.parametrize("shape", CLOSED)
def test_what_begins_inside_leaves_at_a_bounded_speed_and_is_foretold(shape):
    def begin(**settings):
        return one_particle(CLOSED[shape], (0.35, 0.01, 0.02), radius=0.01, gravity=(0, 0, 0), substeps=4, **settings)

    (warning,) = [w for w in begin().check() if w.test == "overlap"]
    assert "particle 0 begins" in warning.text
    sim = begin(depenetration_speed=0.5)
    assert not [w for w in sim.check() if w.test == "overlap"]
    sim.step(frames=60)
    assert np.linalg.norm(sim.velocities[0]) <= 0.5 + 1e-6
    assert sim.collider_overlaps[0].max() < 1e-6


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_sheet_holds_on_both_sides_and_ends_at_its_border(side):
    builder = pbd.ModelBuilder(gravity=(0, -9.81 * side, 0))
    builder.add_particles([(0.1, 0.2 * side, 0.3), (1.4, 0.2 * side, 0.0)], radius=0.03)
    builder.add_mesh(*sheet(2.0, 4))
    sim = pbd.Simulation(builder.finalize(dtype="float64"), substeps=2)
    sim.step(frames=60)
    assert side * sim.positions[0, 1] == pytest.approx(0.03, abs=1e-6)
    assert side * sim.positions[1, 1] < -1.0


def test_a_nook_holds_on_both_its_faces():
    """A ball in a groove of two sheets rests on both, and does not go through either."""
    builder = pbd.ModelBuilder()
    builder.add_particle((0.01, 0.5, 0.1), radius=0.1)
    points = [(-1, 1, -1), (-1, 1, 1), (0, 0, -1), (0, 0, 1), (1, 1, -1), (1, 1, 1)]
    builder.add_mesh(points, [(0, 1, 2), (1, 3, 2), (2, 3, 4), (3, 5, 4)])
    sim = pbd.Simulation(builder.finalize(dtype="float64"), substeps=4, damping=0.5)
    sim.step(frames=240)
    np.testing.assert_allclose(sim.positions[0], [0, 0.1 * np.sqrt(2.0), 0.1], atol=2e-3)
    assert np.linalg.norm(sim.velocities[0]) < 1e-2
