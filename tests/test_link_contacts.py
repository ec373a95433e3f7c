"""Contacts of links in sweeps: who is found, and what they keep."""

import re

import numpy as np
import pytest
from models import heap_model as heap

import pbd_warp as pbd
from pbd_warp.measure import measure, segment_distance
from pbd_warp.model.along import close_along
from pbd_warp.step.constraints import link_contact

METHODS = pytest.mark.parametrize("method", ["jacobi", "gauss-seidel", "direct"])
DTYPES = pytest.mark.parametrize("dtype", ["float32", "float64"])


def found(sim):
    """Of one step from the start: {(a, b): (members, weights, normal, gap)}."""
    loop = sim._loop
    loop.integrator.predict(loop.integrator.stages[0])
    loop.contacts.find()
    links = loop.contacts.links
    rows = {}
    for pair, *row in zip(
        sim.link_pairs,
        *(array.numpy() for array in (links.member, links.weight, links.normal, links.gap)),
        strict=False,
    ):
        assert tuple(pair) not in rows, "a pair was found twice"
        rows[tuple(int(each) for each in pair)] = row
    return rows


@pytest.mark.parametrize("dt", [1e-9, 1 / 240, 1 / 10], ids=["at rest", "a step", "bullets"])
@pytest.mark.parametrize("everybody", [False, True], ids=["grid", "all pairs"])
@DTYPES
def test_every_pair_that_comes_near_in_a_step_is_found(rng, monkeypatch, dt, dtype, everybody):
    monkeypatch.setattr(link_contact, "WITHOUT_GRID", 10**6 if everybody else 0)
    model = heap(rng, dtype=dtype)
    sim = pbd.Simulation(model, dt=dt, max_contacts=20000)
    assert (sim._loop.contacts.links.grid is None) == everybody
    rows = found(sim)
    ends, length = link_contact.capsules(model)
    a, b = np.triu_indices(len(ends), 1)
    start, neighbour = close_along(ends, length, model.radius[ends].max(axis=1), model.particle_count)
    near = set(zip(np.repeat(np.arange(len(ends)), np.diff(start)).tolist(), neighbour.tolist(), strict=True))
    keep = np.array([pair not in near for pair in zip(a.tolist(), b.tolist(), strict=True)])
    a, b = a[keep], b[keep]
    x, u = model.x, sim._context.u.numpy().astype(float)
    rest = model.radius[ends[a]].max(axis=1) + model.radius[ends[b]].max(axis=1)
    least = np.full(len(a), np.inf)
    for time in np.linspace(0.0, 1.0, 201):
        p = x + time * u
        least = np.minimum(least, segment_distance(p[ends[a]], p[ends[b]])[0] / rest - 1.0)
    pairs = list(zip(a.tolist(), b.tolist(), strict=True))
    touching = {pair for pair, gap in zip(pairs, least, strict=True) if gap < 0.0}
    watched = {pair for pair, gap in zip(pairs, least, strict=True) if gap < link_contact.MARGIN}
    assert len(touching) > 30
    assert touching <= set(rows)
    # Between samples in time, and what was on its way still: hardly any.
    assert len(set(rows) - watched) <= 0.02 * len(rows)


def test_a_contact_is_the_half_space_between_the_closest_points(rng):
    model = heap(rng, speed=0.0)
    rows = found(pbd.Simulation(model, dt=1e-9, max_contacts=20000))
    assert any(-1 in member for member, *_ in rows.values())
    ends, _ = link_contact.capsules(model)
    for (a, b), (member, weight, normal, gap) in rows.items():
        side = np.repeat([1, -1], 2)
        np.testing.assert_allclose([weight[:2].sum(), weight[2:].sum()], [1, -1], atol=1e-14)
        assert np.all(weight * side >= 0.0)
        np.testing.assert_array_equal(member, np.where(weight == 0.0, -1, [*ends[a], *ends[b]]))
        there = member >= 0
        between = weight[there] @ model.x[member[there]]
        thick = np.abs(weight[there]) @ model.radius[member[there]]
        np.testing.assert_allclose(np.linalg.norm(normal), 1.0, atol=1e-12)
        np.testing.assert_allclose(np.cross(normal, between), 0.0, atol=1e-12)
        np.testing.assert_allclose(gap, normal @ between - thick, atol=1e-12)
        far = segment_distance(model.x[ends[[a]]], model.x[ends[[b]]])[0][0]
        assert far - 1e-12 <= np.linalg.norm(between) <= far + 1e-3 * thick


def test_neighbours_are_left_out_up_to_half_a_turn_of_the_rope():
    x = np.stack([np.arange(12.0), np.zeros(12), np.zeros(12)], axis=1)
    for radius, most in (0.1, 1), (0.3, 1), (0.33, 2), (0.5, 2):
        builder = pbd.ModelBuilder()
        builder.add_rope(x, radius=radius)
        builder.add_graph(x[:4] + 9.0, [(0, 1), (1, 2), (2, 3), (3, 0)], radius=radius)
        builder.enable_contacts(links=True)
        model = builder.finalize()
        ends, length = link_contact.capsules(model)
        start, neighbour = close_along(ends, length, model.radius[ends].max(axis=1), model.particle_count)
        for e in range(11):
            expected = [f for f in range(11) if 0 < abs(e - f) <= most]
            assert neighbour[start[e] : start[e + 1]].tolist() == expected
        assert neighbour[start[11] : start[12]].tolist() == ([12, 14] if most == 1 else [12, 13, 14])


@pytest.mark.parametrize("method", ["jacobi", "gauss-seidel"])
@DTYPES
def test_momentum_is_kept(rng, method, dtype):
    model = heap(rng, dtype=dtype, restitution=0.5)
    sim = pbd.Simulation(model, method=method, substeps=8, gravity=(0, 0, 0), max_contacts=20000)
    before = measure(sim).momentum
    scale = float(model.mass @ np.linalg.norm(model.v, axis=1))
    touched = 0
    for _ in range(5):
        sim.step()
        touched += len(sim.link_pairs)
    assert touched > 50
    assert not np.allclose(sim.velocities, model.v, atol=0.1)
    np.testing.assert_allclose(measure(sim).momentum, before, atol=(1e-12 if dtype == "float64" else 2e-5) * scale)


def rods(offset=0.0, mass=(0.3, 0.7), restitution=1.0, speed=1.0, friction=0.0):
    """Two rods at right angles, one above the other and falling on it, a quarter of a rod off its middle or at it."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    for m, y, v, along in ((mass[0], 0.03, -speed, (0.5, 0, 0)), (mass[1], 0.0, 0.0, (0, 0, 0.5))):
        along = np.array(along)
        shift = np.array([offset if y > 0.0 else 0.0, y, 0.0])
        ends = builder.add_particles([shift - along, shift + along], velocity=(0, v, 0), mass=m / 2, radius=0.01)
        builder.add_distance(*ends)
    builder.enable_contacts(links=True, restitution=restitution, friction=friction)
    return builder.finalize(dtype="float64")


@METHODS
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_rods_that_meet_at_their_middles_obey_the_law_of_impact(method, restitution):
    """v1' = ((m1 - e m2) v1 + (1 + e) m2 v2) / (m1 + m2), as for balls."""
    m1, m2 = 0.3, 0.7
    sim = pbd.Simulation(rods(mass=(m1, m2), restitution=restitution), method=method, substeps=16)
    sim.step(4)
    v = sim.velocities[:, 1]
    one = -(m1 - restitution * m2) / (m1 + m2)
    two = -(1 + restitution) * m1 / (m1 + m2)
    np.testing.assert_allclose(v, [one, one, two, two], atol=1e-12)


@METHODS
def test_rods_that_meet_off_their_middles_keep_energy_and_turning(method):
    """Exact: the rod that is hit a quarter off turns; impulse J = (1 + e) v / (1/m1 + 1/m2 + r^2/I1), I1 = m1 L^2/4."""
    m1, m2, r = 0.3, 0.7, 0.25
    sim = pbd.Simulation(rods(offset=r, mass=(m1, m2)), method=method, substeps=64)
    before = measure(sim)
    while not np.any(sim.velocities[2:]):
        sim.step()
    after = measure(sim)
    impulse = 2.0 / (1 / m1 + 1 / m2 + r**2 / (m1 * 0.25))
    v = sim.velocities[:, 1]
    np.testing.assert_allclose(v[2:], -impulse / m2, rtol=2e-3)
    np.testing.assert_allclose(
        v[:2], -1.0 + impulse / m1 + np.array([1, -1]) * impulse * r / (m1 * 0.25) / 2, atol=5e-3
    )
    np.testing.assert_allclose(after.momentum, before.momentum, atol=1e-12)
    np.testing.assert_allclose(after.kinetic, before.kinetic, rtol=5e-3)
    np.testing.assert_allclose(after.angular_momentum, before.angular_momentum, atol=1e-4)


def side(x):
    """On which side of the first link the second one passes it by."""
    return np.dot(np.cross(x[1] - x[0], x[2] - x[3]), x[2] - x[0])


@METHODS
@DTYPES
@pytest.mark.parametrize("speed", [1.0, 10.0, 100.0])
def test_a_thin_fast_rod_does_not_tunnel(method, dtype, speed):
    """A needle flies at another, in steps of up to 800 of its radii."""
    for phase in np.linspace(0.0, 1.0, 7):
        builder = pbd.ModelBuilder(gravity=(0, 0, 0))
        target = builder.add_particles([(-0.5, 0, 0), (0.5, 0, 0)], mass=1.0, radius=0.001)
        needle = builder.add_particles(
            [(0.1, speed * (0.02 + phase / 60), -0.3), (0.15, speed * (0.02 + phase / 60), 0.4)],
            velocity=(0, -speed, 0),
            mass=1.0,
            radius=0.001,
        )
        builder.add_distance(*target)
        builder.add_distance(*needle)
        builder.enable_contacts(links=True)
        sim = pbd.Simulation(builder.finalize(dtype=dtype), method=method, substeps=2, on_failure="continue")
        while not np.any(sim.velocities[:2]):
            sim.step()
        x = sim.positions.astype(float)
        assert side(x) > 0.0
        assert measure(sim).overlap < 1e-4


@METHODS
def test_a_ball_that_meets_the_middle_of_a_rod_obeys_the_law_of_impact(method):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_distance(*builder.add_particles([(-0.5, 0, 0), (0.5, 0, 0)], mass=0.35, radius=0.01))
    builder.add_particle((0, 0.05, 0), velocity=(0, -1, 0), mass=0.3, radius=0.02)
    builder.enable_contacts(links=True, restitution=0.5)
    sim = pbd.Simulation(builder.finalize(dtype="float64"), method=method, substeps=16)
    sim.step(4)
    np.testing.assert_allclose(sim.velocities[:, 1], [-0.45, -0.45, 0.05], atol=1e-12)


def test_copies_in_one_place_do_not_meet(rng, monkeypatch):
    """With all pairs and with a grid: each copy goes as it would alone."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    for y, along in (0.03, (0.3, 0, 0)), (0.0, (0, 0, 0.3)):
        ends = builder.add_particles([(0, y, 0), along], velocity=(0, -y * 30, 0), mass=0.1, radius=0.01)
        builder.add_distance(*ends)
    builder.add_particle((0.2, 0.02, 0), mass=0.1, radius=0.01)
    builder.enable_contacts(links=True)
    alone = pbd.Simulation(builder.finalize(dtype="float64"))
    alone.step(4)
    for everybody in True, False:
        monkeypatch.setattr(link_contact, "WITHOUT_GRID", 150 if everybody else 0)
        sim = pbd.Simulation(builder.replicate(3).finalize(dtype="float64"))
        sim.step(4)
        assert len(sim.link_pairs) == 3 * len(alone.link_pairs) > 0
        np.testing.assert_array_equal(sim.positions.reshape(3, -1, 3), np.broadcast_to(alone.positions, (3, 5, 3)))


@METHODS
def test_a_ball_stays_on_a_link(method):
    """Between its ends, where particle contacts see nothing."""
    for links in True, False:
        builder = pbd.ModelBuilder()
        builder.add_rope([(-0.5, 0, 0), (0.5, 0, 0)], pinned=(0, 1), radius=0.01)
        builder.add_particle((0.1, 0.05, 0), radius=0.02)
        builder.enable_contacts(links=links)
        sim = pbd.Simulation(builder, method=method, substeps=4)
        sim.step(30)
        height = sim.positions[2, 1]
        assert height == pytest.approx(0.03, abs=1e-5) if links else height < -0.5


@METHODS
def test_a_long_link_does_not_cut_a_ball(method):
    """Its ends pass on either side of the ball's top, far below it."""
    for links in True, False:
        builder = pbd.ModelBuilder()
        builder.add_rope([(-0.5, 0.35, 0.0), (0.5, 0.35, 0.0)], pinned=(), radius=0.01)
        builder.add_sphere((0, 0, 0), 0.3)
        builder.enable_contacts(links=links)
        sim = pbd.Simulation(builder, method=method, substeps=4)
        sim.step(30)
        middle = sim.positions[:, 1].mean()
        assert middle == pytest.approx(0.31, abs=1e-4) if links else middle < 0.2


@METHODS
def test_friction_holds_on_a_link_up_to_its_coefficient(method):
    """A rod across two rails that slope by 20 degrees: tan is 0.364."""
    slides = []
    for friction in 0.3, 0.42:
        builder = pbd.ModelBuilder()
        down = np.array([np.cos(np.radians(20)), -np.sin(np.radians(20)), 0.0])
        up = np.array([np.sin(np.radians(20)), np.cos(np.radians(20)), 0.0])
        for z in -0.2, 0.2:
            side = np.array([0, 0, z])
            builder.add_rope([side - down, side + down], pinned=(0, 1), radius=0.01)
        ends = builder.add_particles([0.02 * up + (0, 0, -0.4), 0.02 * up + (0, 0, 0.4)], mass=0.5, radius=0.01)
        builder.add_distance(*ends)
        builder.enable_contacts(links=True, friction=friction)
        sim = pbd.Simulation(builder.finalize(dtype="float64"), method=method, substeps=16)
        sim.step(30)
        slides.append(float((sim.positions[4:].mean(axis=0) - 0.02 * up) @ down))
    fall = 0.5 * 9.81 * 0.5**2 * (np.sin(np.radians(20)) - 0.3 * np.cos(np.radians(20)))
    assert slides[0] == pytest.approx(fall, rel=0.05)
    assert abs(slides[1]) < 1e-3


def test_a_pair_that_was_left_deep_inside_parts_on_its_own_side():
    """The upper rod is put below the lower one's axis while they push each other: it goes back up."""
    sim = pbd.Simulation(rods(restitution=0.0), method="gauss-seidel")
    while not sim._loop.contacts.links.lam.numpy().any():
        sim.step()
    x = sim.positions
    x[:2, 1] = x[2:, 1].mean() - 0.004
    sim.state.x.assign(x)
    sim.state.v.zero_()
    sim.step()
    assert sim.positions[0, 1] - sim.positions[2, 1] == pytest.approx(0.02, rel=0.02)


def test_after_a_reset_it_goes_as_the_first_time(rng):
    sim = pbd.Simulation(heap(rng), substeps=2, max_contacts=20000)
    sim.step(4)
    first = sim.positions
    sim.reset()
    sim.step(4)
    np.testing.assert_array_equal(sim.positions, first)


def test_what_does_not_ask_for_links_has_nothing_of_them(rng):
    with_links, without = (pbd.Simulation(heap(rng, links=links)) for links in (True, False))
    assert any("link" in name for name in with_links.passes)
    assert any(name.startswith("link.") for name in with_links.memory)
    assert not any("link" in name for name in without.passes)
    assert not any(name.startswith("link.") for name in without.memory)


def test_overflow_is_an_error_that_says_how_much_room_it_takes(rng):
    model = heap(rng)
    with pytest.raises(pbd.SimulationFailed, match=r"contacts, but there is room for 3; .* max_contacts=") as caught:
        pbd.Simulation(model, max_contacts=3).step()
    enough = int(re.search(r"max_contacts=(\d+)", str(caught.value)).group(1))
    pbd.Simulation(model, max_contacts=enough).step()


@pytest.mark.parametrize(
    ("radius", "sentence"),
    [
        (0.0, r"the link of particles 0 and 1 has a radius of 0, .*: give its particles a radius"),
        (
            0.06,
            r"the link of particles 0 and 1 is 0\.12 m thick and 0\.1 m long, .* longer than thick: use fewer points",
        ),
    ],
)
def test_links_that_cannot_be_capsules(radius, sentence):
    builder = pbd.ModelBuilder()
    builder.add_rope([(0.1 * k, 0, 0) for k in range(4)], radius=radius)
    builder.add_particle((0, 1, 0), radius=0.1)
    builder.enable_contacts(links=True)
    with pytest.raises(pbd.InputError, match=sentence):
        builder.finalize()
