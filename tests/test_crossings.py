"""Passages of links, found, and not found where there is none; linking number and writhe."""

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.cli.run import table
from pbd_warp.crossings import find_crossings
from pbd_warp.measure import measure
from pbd_warp.run import run
from pbd_warp.topology import linking_number, writhe

AWAY = np.array([1.5, 0.0, 0.0])
TWO = np.array([(0, 1), (2, 3)])
CROSS = np.array([[-1, 0, 0.1], [1, 0, 0.1], [0, -1, 0], [0, 1, 0]], float)


def moved(**by):
    x = CROSS.copy()
    x[:2] += [by.get("x", 0.0), by.get("y", 0.0), by.get("z", 0.0)]
    return x


def test_a_link_that_goes_through_another_is_named_with_time_and_place():
    (crossing,) = find_crossings(CROSS, moved(z=-0.4), TWO, frame=7)
    assert (crossing.frame, crossing.links) == (7, (0, 1))
    assert crossing.time == pytest.approx(0.25, abs=1e-12)
    np.testing.assert_allclose(crossing.point, (0, 0, 0), atol=1e-12)
    assert str(crossing) == "links 0 and 1 passed through each other in frame 7 at (0, 0, 0) m"


@pytest.mark.parametrize(
    "by",
    [{"z": -0.0999}, {"z": 5.0}, {"z": -0.4, "x": 4.1}, {"y": 0.9}, {}],
    ids=["near", "up", "past", "over", "rest"],
)
def test_what_only_comes_near_does_not(by):
    assert find_crossings(CROSS, moved(**by), TWO) == []


def test_there_and_back_in_one_frame_and_another_is_two():
    assert len(find_crossings(CROSS, moved(z=-0.2), TWO)) == len(find_crossings(moved(z=-0.2), CROSS, TWO)) == 1


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_random_motions_against_a_search_in_time(seed, scale):
    """A passage turns the sign of the triple product while both lines cross inside: sampled finely."""
    rng = np.random.default_rng(seed)
    n = 100
    x, y = rng.normal(size=(2, 4 * n, 3))
    link = np.arange(4 * n).reshape(-1, 2)
    expected = np.zeros(n, int)
    before = None
    for time in np.linspace(0.0, 1.0, 1001):
        p = ((1.0 - time) * x + time * y).reshape(n, 4, 3)
        a, b, r = p[:, 1] - p[:, 0], p[:, 3] - p[:, 2], p[:, 2] - p[:, 0]
        normal = np.cross(a, b)
        f = np.sum(normal * r, axis=1)
        s, t = (np.sum(np.cross(r, d) * normal, axis=1) / np.sum(normal**2, axis=1) for d in (b, a))
        if before is not None:
            expected += (f * before < 0) & (s > 0) & (s < 1) & (t > 0) & (t < 1)
        before = f
    found = np.zeros(n, int)
    for k in range(n):
        rows = slice(4 * k, 4 * k + 4)
        found[k] = len(find_crossings(scale * x[rows], scale * y[rows], TWO))
    assert expected.sum() > 15
    # Two passages within a sample, or one at an end, are what the samples do not see.
    assert np.count_nonzero(found != expected) <= 0.02 * n
    everything = find_crossings(scale * x, scale * y, link)
    own = [crossing for crossing in everything if crossing.links[0] // 2 == crossing.links[1] // 2]
    assert len(own) == found.sum()
    assert len(everything) > 5 * len(own)


@pytest.mark.parametrize("at", [0.0, 0.3, 1.0], ids=["a joint", "a link", "the next joint"])
def test_a_passage_through_a_joint_is_one(at):
    rope = np.array([(-1.0, 0, 0), (0, 0, 0), (1, 0, 0), (2, 0, 0)])
    other = np.array([(at, -1, 0.1), (at, 1, 0.1)])
    link = np.array([(0, 1), (1, 2), (2, 3), (4, 5)])
    x = np.concatenate([rope, other])
    y = x + np.where(np.arange(6)[:, None] > 3, (0, 0, -0.3), 0.0)
    assert len(find_crossings(x, y, link)) == 1


def test_neighbours_of_one_rope_do_not_count():
    x = np.array([(0.0, 0, 0), (1, 0, 0), (2, 0, 0)])
    y = np.array([(0.0, 0, 0), (1, 0, 0), (0, 0.1, 0)])
    assert find_crossings(x, y, np.array([(0, 1), (1, 2)])) == []


@pytest.mark.parametrize("tilt", [0.0, 0.3])
def test_links_in_one_plane(tilt):
    """An end goes over the other link, or stops short of it."""
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
    x = np.array([(-1.0, 0, 0), (1, 0, 0), (0.2, 0.1, 0), (0.3, 1.1, 0)])
    for down, count in (-0.2, 1), (-0.05, 0), (0.2, 0):
        y = x + np.where(np.arange(4)[:, None] > 1, (0.01, down, 0), 0.0)
        found = find_crossings(x @ turn, y @ turn, TWO)
        assert len(found) == count
    assert find_crossings(x @ turn, (x + np.array([0.0, 3.0, 0.0])) @ turn, TWO) == []


def ring(n=40, centre=(0, 0, 0), turned=False, twist=1):
    angle = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    flat = np.stack([np.cos(angle), np.sin(twist * angle), 0.0 * angle], axis=1)
    return (flat[:, [0, 2, 1]] if turned else flat) + centre


def test_linking_numbers():
    assert linking_number(ring(), ring(centre=(1, 0, 0), turned=True)) == pytest.approx(1.0, abs=1e-12) or (
        linking_number(ring(), ring(centre=(1, 0, 0), turned=True)) == pytest.approx(-1.0, abs=1e-12)
    )
    assert linking_number(ring(), ring(centre=(3, 0, 0), turned=True)) == pytest.approx(0.0, abs=1e-12)
    t = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    wound = np.stack(
        [(1 + 0.2 * np.cos(3 * t)) * np.cos(t), (1 + 0.2 * np.cos(3 * t)) * np.sin(t), 0.2 * np.sin(3 * t)], 1
    )
    assert abs(linking_number(ring(), wound)) == pytest.approx(3.0, abs=1e-12)


def test_writhe_of_a_trefoil_and_of_a_plane_curve():
    t = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    trefoil = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    assert abs(writhe(trefoil, closed=True)) == pytest.approx(3.4, abs=0.2)
    assert writhe(trefoil * (1, 1, -1), closed=True) == pytest.approx(-writhe(trefoil, closed=True), abs=1e-12)
    assert writhe(ring()) == pytest.approx(0.0, abs=1e-12)


def test_a_passage_changes_the_writhe_by_two_and_the_linking_number_by_one():
    t = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    eight = np.stack([np.cos(t), 0.5 * np.sin(2 * t), 1e-4 * np.sin(t)], axis=1)
    other = eight * (1, 1, -1)
    link = np.stack([np.arange(60), np.roll(np.arange(60), -1)], axis=1)
    assert len(find_crossings(eight, other, link)) == 1
    assert abs(writhe(other, closed=True) - writhe(eight, closed=True)) == pytest.approx(2.0, abs=1e-2)
    a, b = ring(), ring(centre=(1, 0.01, 0), turned=True)
    x, y = np.concatenate([a, b]), np.concatenate([a, b + AWAY])
    links = np.concatenate([np.stack([np.arange(40), np.roll(np.arange(40), -1)], axis=1) + k for k in (0, 40)])
    through = find_crossings(x, y, links)
    assert len(through) == 1
    assert abs(linking_number(a, b)) == pytest.approx(1.0, abs=1e-12)
    assert linking_number(a, b + AWAY) == pytest.approx(0.0, abs=1e-12)


def falling_rods(links, dtype="float64"):
    """One rod falls on another that is held, faster than its thickness a frame."""
    builder = pbd.ModelBuilder()
    for y, along, pinned in (0.0, (1, 0, 0), (0, 1)), (0.5, (0, 0, 1), ()):
        ends = np.array([(0, y, 0), (0, y, 0)]) + np.outer((-0.5, 0.5), along)
        builder.add_rope(ends, pinned=pinned, radius=0.01)
    builder.enable_contacts(**({"links": True} if links else {}))
    return builder.finalize(dtype=dtype)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_particle_contacts_let_a_rod_through_and_the_watch_says_so(dtype):
    sim = pbd.Simulation(falling_rods(False, dtype))
    with pytest.raises(pbd.InputError, match="call watch_crossings"):
        _ = sim.crossings
    assert measure(sim).crossings is None
    sim.watch_crossings()
    sim.step(30)
    (crossing,) = sim.crossings
    fallen = next(k for k in range(1, 30) if 0.5 - 9.81 * k * (k + 1) / 2 / 3600 < 0.0)
    assert (crossing.frame, crossing.links) == (fallen, (0, 1))
    np.testing.assert_allclose(crossing.point, (0, 0, 0), atol=1e-6)
    assert measure(sim).crossings == 1
    sim.reset()
    assert sim.crossings == []
    sim.step(30)
    assert sim.crossings == [crossing]


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("method", ["jacobi", "gauss-seidel", "direct"])
def test_link_contacts_let_nothing_through(dtype, method):
    sim = pbd.Simulation(falling_rods(True, dtype), method=method, substeps=4)
    sim.watch_crossings()
    sim.step(30)
    assert sim.crossings == []
    assert sim.positions[2:, 1].mean() > 0.0


def test_who_watches_sees_the_same_motion():
    one, other = (pbd.Simulation(falling_rods(False)) for _ in range(2))
    one.watch_crossings()
    for sim in one, other:
        sim.step(20)
    np.testing.assert_array_equal(one.positions, other.positions)


def test_copies_do_not_pass_through_each_other():
    builder = pbd.ModelBuilder()
    builder.add_rope([(-0.5, 0, 0), (0.5, 0, 0)], pinned=())
    builder.add_rope([(0, 1, -0.5), (0, 1, 0.5)], pinned=())
    x = np.array(
        [[(-0.5, 0, 0), (0.5, 0, 0), (0, 1, -0.5), (0, 1, 0.5)], [(0, 2, -0.5), (0, 2, 0.5), (1, 9, 0), (2, 9, 0)]]
    )
    sim = pbd.Simulation(builder.replicate(2, positions=x), gravity=(0, 0, 0))
    sim.watch_crossings()
    v = np.zeros((8, 3))
    v[4:6, 1] = -60.0  # of the second copy, through both links of the first and out again
    sim.state.v.assign(v)
    sim.step(3)
    assert sim.positions[4, 1] < -0.5
    assert sim.crossings == []


def test_a_run_ends_with_what_passed_through(tmp_path):
    builder = pbd.ModelBuilder()
    model = falling_rods(False)
    for k in 0, 2:
        builder.add_rope(model.x[k : k + 2], pinned=(0, 1) if k == 0 else (), radius=0.01)
    builder.enable_contacts()
    for frames, ending in (
        (5, "no strand passed through another"),
        (30, "passed through each other 1 times, first links 0"),
    ):
        stats = run(pbd.Scene(builder, frames=frames, name="rods"), tmp_path / f"{frames}.usda")
        assert ending in table(stats)
        assert stats.crossings == (frames == 30)
    assert "enable_contacts(links=True)" in stats.crossed
