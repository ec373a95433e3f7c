"""Every kernel by itself against NumPy in float64, on random and degenerate input."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_io import REALS, run, tolerance, vec

from pbd_warp.kernels.bounce import bounce, count_active
from pbd_warp.kernels.collider import find_collider_contacts
from pbd_warp.kernels.contact import note_overflow, project_contact, sweep_midpoints
from pbd_warp.kernels.damping import (
    damp_velocities,
    divide_by_mass,
    find_rotation,
    sum_angular_momentum,
    sum_momentum,
)
from pbd_warp.kernels.distance import project_distance
from pbd_warp.kernels.integrate import accelerate, predict, update
from pbd_warp.kernels.jacobi import add_corrections
from pbd_warp.kernels.kinematic import move_to_targets, stop
from pbd_warp.kernels.point import project_point

both_precisions = pytest.mark.parametrize("real", REALS)


@st.composite
def graphs(draw):
    """A small random graph: edges [m, 2], x, u [n, 3], w [n], with coincident and fixed particles among them."""
    n = draw(st.integers(2, 6))
    m = draw(st.integers(0, 8))
    # Multiples of 1/4 in a small range: zero lengths are common, and every coordinate is exact in float32.
    coordinate = st.integers(-2, 2).map(lambda k: 0.25 * k)
    x = np.array(draw(st.lists(st.tuples(*[coordinate] * 3), min_size=n, max_size=n)))
    u = np.array(draw(st.lists(st.tuples(*[coordinate] * 3), min_size=n, max_size=n))) / 8
    w = np.array(draw(st.lists(st.sampled_from([0.0, 0.5, 1.0, 4.0]), min_size=n, max_size=n)))
    i = np.array(draw(st.lists(st.integers(0, n - 1), min_size=m, max_size=m)), dtype=int)
    step = np.array(draw(st.lists(st.integers(1, n - 1), min_size=m, max_size=m)), dtype=int)
    return np.stack([i, (i + step) % n], axis=1), x, u, w


def distance_oracle(edge, rest, k, alpha, x, w, u, share, relaxation, lam):
    move, lam = np.zeros_like(x), lam.copy()
    for e, (i, j) in enumerate(edge):
        weight = share[i] * w[i] + share[j] * w[j]
        if weight == 0.0:
            continue
        d = (x[i] + u[i]) - (x[j] + u[j])
        length = np.sqrt(d @ d)
        n = d / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
        dlam = -relaxation * k[e] * (length - rest[e] + alpha[e] * lam[e]) / (weight + alpha[e])
        lam[e] += dlam
        move[i] += w[i] * dlam * n
        move[j] -= w[j] * dlam * n
    return move, lam


@both_precisions
@given(graph=graphs(), soft=st.booleans(), relaxation=st.sampled_from([1.0, 0.5, 1.5]))
def test_project_distance(real, graph, soft, relaxation):
    edge, x, u, w = graph
    m, n = len(edge), len(x)
    rest = 0.25 + 0.25 * np.arange(m) / 8
    k = np.full(m, 0.75 if soft else 1.0)
    alpha = np.full(m, 0.5 if soft else 0.0)
    lam = 0.125 * np.arange(m)
    share = np.bincount(edge.ravel(), minlength=n)
    optional = (k, alpha) if soft else (None, None)
    out = run(
        project_distance, real, m, edge, rest, *optional, x, w, u, share, relaxation,
        np.ones(1), False, lam if soft else None, np.zeros(1), np.zeros((n, 3)),
    )  # fmt: skip
    before = lam if soft else np.zeros(m)
    move, lam = distance_oracle(edge, rest, k, alpha, x, w, u, share, relaxation, before)
    np.testing.assert_allclose(out[-1], move, atol=64 * tolerance(real))
    if soft:
        np.testing.assert_allclose(out[-3], lam, atol=64 * tolerance(real))
    i, j = edge.T
    left = np.abs(np.linalg.norm(x[i] + u[i] - x[j] - u[j], axis=1) - rest + alpha * before)
    largest = np.max(left[(w[i] > 0.0) | (w[j] > 0.0)], initial=0.0)
    np.testing.assert_allclose(out[-2], largest, atol=64 * tolerance(real))
    # Newton's third law: what the constraints do to the momentum of free particles cancels.
    if np.all(w > 0.0):
        np.testing.assert_allclose((out[-1] / w[:, None]).sum(axis=0), 0.0, atol=64 * tolerance(real))


@both_precisions
def test_project_distance_without_mass_splitting_divides_by_the_plain_weight(real):
    edge, x = np.array([[0, 1], [1, 2]]), np.array([[0.0, 0, 0], [2, 0, 0], [4, 0, 0]])
    out = run(
        project_distance, real, 2, edge, np.ones(2), None, None, x, np.ones(3), np.zeros((3, 3)), None, 1.0,
        np.ones(1), False, None, None, np.zeros((3, 3)),
    )  # fmt: skip
    np.testing.assert_array_equal(out[-1], [[0.5, 0, 0], [0, 0, 0], [-0.5, 0, 0]])


@both_precisions
def test_project_distance_leaves_a_pair_of_fixed_particles(real):
    x = np.array([[0.0, 0, 0], [2, 0, 0]])
    out = run(
        project_distance, real, 1, np.array([[0, 1]]), np.ones(1), None, None, x, np.zeros(2), np.zeros((2, 3)), None,
        1.0, np.ones(1), False, None, None, np.zeros((2, 3)),
    )  # fmt: skip
    np.testing.assert_array_equal(out[-1], 0.0)


@both_precisions
@given(graph=graphs(), soft=st.booleans())
def test_project_point(real, graph, soft):
    edge, x, u, w = graph
    particle = edge[:, 0]
    m, n = len(particle), len(x)
    target = np.full((m, 3), 0.5)
    share = np.bincount(particle, minlength=n)
    k, alpha, lam = (0.75, 0.5, np.full((m, 3), 0.25)) if soft else (1.0, 0.0, np.zeros((m, 3)))
    optional = (np.full(m, k), np.full(m, alpha)) if soft else (None, None)
    out = run(
        project_point, real, m, particle, target, *optional, x, w, u, share, 1.0, np.ones(1), False,
        lam if soft else None, None, np.zeros((n, 3)),
    )  # fmt: skip
    move = np.zeros((n, 3))
    for e, i in enumerate(particle):
        if w[i] > 0.0:
            dlam = -k * (x[i] + u[i] - target[e] + alpha * lam[e]) / (share[i] * w[i] + alpha)
            lam[e] += dlam
            move[i] += w[i] * dlam
    np.testing.assert_allclose(out[-1], move, atol=64 * tolerance(real))
    if soft:
        np.testing.assert_allclose(out[-3], lam, atol=64 * tolerance(real))


@both_precisions
def test_accelerate_moves_only_what_has_mass(real):
    out = run(accelerate, real, 2, vec(REALS[real])(0.0, -8.0, 0.0), np.array([2.0, 0.0]), 0.25, np.ones((2, 3)))
    np.testing.assert_array_equal(out[-1], [[1, -1, 1], [1, 1, 1]])


@both_precisions
def test_predict(real):
    v = np.array([[1.0, 0, 0], [0, 0, 0], [0, 2, 0]])
    w = np.array([1.0, 0.0, 0.0])
    v_new, u = run(predict, real, 3, vec(REALS[real])(0.0, -8.0, 0.0), w, 0.25, 0.5, v, np.zeros((3, 3)))[-2:]
    # One falls, half as far by drag, one is fixed and rests, one is fixed and led: nothing changes its velocity.
    np.testing.assert_array_equal(v_new, [[1, -2, 0], [0, 0, 0], [0, 2, 0]])
    np.testing.assert_array_equal(u, [[0.125, -0.25, 0], [0, 0, 0], [0, 0.5, 0]])


@both_precisions
def test_kinematic_particles_reach_their_targets_and_stop(real):
    x, v = np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]]), np.full((3, 3), 7.0)
    particle, target = np.array([2, 0]), np.array([[2.0, 4, 2], [1, 0, 0]])
    moved = run(move_to_targets, real, 2, x, particle, target, 0.25, v)[-1]
    np.testing.assert_array_equal(moved, [[4, 0, 0], [7, 7, 7], [0, 8, 0]])
    np.testing.assert_array_equal(run(stop, real, 2, particle, v)[-1], [[0, 0, 0], [7, 7, 7], [0, 0, 0]])


@both_precisions
def test_update(real):
    never = np.array([99])
    out = run(update, real, 1, np.array([[0.5, 0, 0]]), 0.25, np.ones((1, 3)), np.ones((1, 3)), never)
    np.testing.assert_array_equal(out[2], [[1.5, 1, 1]])
    np.testing.assert_array_equal(out[3], [[2, 0, 0]])
    assert out[4] == 99


@both_precisions
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_update_names_the_first_particle_that_is_not_finite(real, bad):
    u = np.zeros((5, 3))
    u[2, 1] = u[4, 0] = bad
    out = run(update, real, 5, u, 1.0, np.zeros((5, 3)), np.zeros((5, 3)), np.array([99]))
    assert out[4] == 2


@both_precisions
@pytest.mark.parametrize("divided", [False, True])
def test_add_corrections_takes_and_clears(real, divided):
    correction = np.array([[1.0, 2, 3], [4, 5, 6]])
    divisor = np.array([2, 0]) if divided else None  # 0 constraints divide by nothing
    out = run(add_corrections, real, 2, divisor, correction, np.ones((2, 3)))
    np.testing.assert_array_equal(out[1], 0.0)
    np.testing.assert_array_equal(out[2], 1.0 + correction / ([[2], [1]] if divided else 1))


def damp(real, x, v, w, component, k):
    """The five damping kernels in a row."""
    _, first = np.unique(component, return_index=True)
    n, c = len(x), len(first)
    sums = [np.zeros(c), np.zeros((c, 3)), np.zeros((c, 3))]
    sums = run(sum_momentum, real, n, component, first, x, v, w, *sums)[-3:]
    means = run(divide_by_mass, real, c, *sums)[-2:]
    angular, inertia = run(
        sum_angular_momentum, real, n, component, first, x, v, w, *means, np.zeros((c, 3)), np.zeros((c, 3, 3))
    )[-2:]
    cutoff = 16.0 * np.finfo(real).eps
    omega = run(find_rotation, real, c, angular, inertia, cutoff, np.zeros((c, 3)))[-1]
    return run(damp_velocities, real, n, component, first, x, w, *means, omega, k, v)[-1]


SHAPES = {
    "one particle": np.array([[1.0, 2, 3]]),
    "two particles": np.array([[0.0, 0, 0], [0.5, 0.25, -1]]),
    "straight rope": np.linspace([0.0, 0, 0], [1, 2, -1], 9),
    "two at one place": np.ones((2, 3)),
    "cloud": np.random.default_rng(3).normal(size=(12, 3)),
    "plane": np.random.default_rng(4).normal(size=(12, 3)) * [1, 1, 0],
}


@both_precisions
@pytest.mark.parametrize("shape", SHAPES)
def test_full_damping_leaves_the_rigid_motion(real, shape, rng):
    """k = 1: linear and angular momentum as before, and no two particles move apart or together."""
    x = SHAPES[shape]
    n = len(x)
    v, w = rng.normal(size=(n, 3)), rng.choice([0.5, 1.0, 2.0], n)
    new = damp(real, x, v, w, np.zeros(n, int), 1.0)
    m = 1.0 / w[:, None]
    scale = np.abs(m).sum() * (1.0 + np.abs(x).max()) * np.abs(v).max()
    np.testing.assert_allclose((m * new).sum(0), (m * v).sum(0), atol=scale * tolerance(real))
    np.testing.assert_allclose(np.cross(x, m * new).sum(0), np.cross(x, m * v).sum(0), atol=scale * tolerance(real))
    i, j = np.triu_indices(n, 1)
    closing = np.sum((x[i] - x[j]) * (new[i] - new[j]), axis=1)
    np.testing.assert_allclose(closing, 0.0, atol=scale * tolerance(real))
    if n > 1:
        assert not np.allclose(new, v)


@both_precisions
def test_damping_is_for_each_component_and_skips_fixed_particles(real, rng):
    x, v, w = rng.normal(size=(6, 3)), rng.normal(size=(6, 3)), np.array([1.0, 1, 0, 2, 2, 2])
    component = np.array([0, 0, 0, 1, 1, 1])
    both = damp(real, x, v, w, component, 0.5)
    np.testing.assert_allclose(both[2], v[2], atol=tolerance(real, 1.0))
    second = damp(real, x[3:], v[3:], w[3:], np.zeros(3, int), 0.5)
    np.testing.assert_allclose(both[3:], second, atol=tolerance(real))


@both_precisions
def test_an_axis_without_inertia_does_not_turn(real):
    """The inertia of a straight line and its momentum as rounding leaves them, and an ordinary body beside it."""
    noise = 0.25 * np.finfo(real).eps
    inertia = np.array([np.diag([1.0, 1.0, noise]), np.diag([1.0, 2.0, 4.0])])
    momentum = np.array([[0.5, 0.0, 16.0 * noise], [1.0, 1.0, 1.0]])
    omega = run(find_rotation, real, 2, momentum, inertia, 16.0 * np.finfo(real).eps, np.zeros((2, 3)))[-1]
    np.testing.assert_allclose(omega, [[0.5, 0, 0], [1, 0.5, 0.25]], atol=tolerance(real))


@both_precisions
def test_sweep_midpoints(real):
    out = run(sweep_midpoints, real, 1, np.array([[1.0, 0, 0]]), np.array([[0.0, 3, 4]]), np.zeros((1, 3)), np.zeros(1))
    np.testing.assert_array_equal(out[2], [[1, 1.5, 2]])
    np.testing.assert_array_equal(out[3], [5])


@pytest.mark.parametrize(("found", "before", "after"), [(3, 0, 0), (4, 0, 0), (5, 0, 5), (2, 7, 7), (9, 7, 9)])
def test_note_overflow_keeps_the_most(found, before, after):
    out = run(note_overflow, "float32", 1, np.array([found]), 4, np.array([1, 2, 3, 4, before]))[-1]
    np.testing.assert_array_equal(out, [1, 2, 3, 4, after])


def project_one_contact(real, x, u, w, normal, gap, lam, radius=0.5, share=(1, 1), mu=0.0):
    x, u, w = np.array(x, float), np.array(u, float), np.array(w, float)
    pair = np.array([[0, 1 if len(x) > 1 else -1]])
    out = run(
        project_contact, real, 3, np.full(len(x), radius), mu, np.array([mu]), x, w, np.array([1]), pair,
        np.array([normal], float), np.array([gap], float), None, u, np.array(share[: len(x)]), 1.0,
        np.array([lam], float), np.zeros((1, 3)) if mu else None, np.zeros(1), np.zeros((len(x), 3)),
    )  # fmt: skip
    return out[-4][0], out[-1]


@both_precisions
def test_a_round_contact_pushes_only_what_overlaps(real):
    touching = [[0.0, 0, 0], [0.5, 0, 0]]
    lam, move = project_one_contact(real, touching, np.zeros((2, 3)), [1, 1], (0, 0, 0), 0.0, 0.0)
    assert lam == 0.25
    np.testing.assert_array_equal(move, [[-0.25, 0, 0], [0.25, 0, 0]])
    lam, move = project_one_contact(real, [[0.0, 0, 0], [2, 0, 0]], np.zeros((2, 3)), [1, 1], (0, 0, 0), 0.0, 0.0)
    assert lam == 0.0
    np.testing.assert_array_equal(move, 0.0)


@both_precisions
def test_a_contact_takes_back_what_it_pushed_too_far_but_never_pulls(real):
    apart = [[0.0, 0, 0], [1.5, 0, 0]]
    lam, move = project_one_contact(real, apart, np.zeros((2, 3)), [1, 1], (0, 0, 0), 0.0, 0.125)
    assert lam == 0.0
    np.testing.assert_array_equal(move, [[0.125, 0, 0], [-0.125, 0, 0]])


@both_precisions
def test_a_half_space_contact_holds_a_particle_that_went_through(real):
    """It went from y = 1 to y = -1 through a collider's plane y = 0, with radius 0.5."""
    lam, move = project_one_contact(real, [[0.0, 1, 0]], [[0.0, -2, 0]], [2], (0, 1, 0), 0.5, 0.0, share=(1,))
    assert lam == 0.75
    np.testing.assert_array_equal(move, [[0, 1.5, 0]])


@both_precisions
def test_a_contact_splits_masses(real):
    x = [[0.0, 0, 0], [0.5, 0, 0]]
    lam, move = project_one_contact(real, x, np.zeros((2, 3)), [1, 1], (0, 0, 0), 0.0, 0.0, share=(3, 1))
    assert lam == 0.125
    np.testing.assert_array_equal(move, [[-0.125, 0, 0], [0.125, 0, 0]])


@both_precisions
def test_coincident_particles_in_contact_separate(real):
    lam, move = project_one_contact(real, [[1.0, 1, 1], [1, 1, 1]], np.zeros((2, 3)), [1, 1], (0, 0, 0), 0.0, 0.0)
    assert lam == 0.5
    np.testing.assert_array_equal(move, [[0.5, 0, 0], [-0.5, 0, 0]])


def test_count_active_counts_contacts_that_pushed():
    pair = np.array([[0, 1], [1, -1], [0, 2], [2, 1]])
    out = run(
        count_active, "float64", 4, np.array([3]), pair, np.array([0.5, 0.25, 0.0, 1.0]), np.zeros(3, dtype=np.int32)
    )
    np.testing.assert_array_equal(out[-1], [1, 2, 0])  # the fourth lies beyond the count


@both_precisions
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_bounce_is_the_law_of_impact(real, e):
    w = np.array([1.0, 0.25])  # masses 1 and 4
    before = np.array([[3.0, 1, 0], [-1, 0, 0]])
    v = np.array([[0.25, 1, 0], [-0.3125, 0, 0]])  # any v of the same momentum along the normal
    out = run(
        bounce, real, 1, 0.0, e, np.zeros(0), np.zeros(0), 0.0, 1.0, np.array([[0.0, 0, 0], [1, 0, 0]]), v, w,
        np.array([1]), np.array([[0, 1]]), np.zeros((1, 3)), None, np.array([0.5]), before, np.array([1, 1]),
        np.zeros((2, 3)),
    )  # fmt: skip
    momentum, closing = v[0, 0] + 4.0 * v[1, 0], 4.0
    expected = np.array([(momentum - 4.0 * e * closing) / 5.0, (momentum + e * closing) / 5.0])
    np.testing.assert_allclose((v + out[-1])[:, 0], expected, atol=8 * tolerance(real))
    np.testing.assert_array_equal(out[-1][:, 1:], 0.0)


@both_precisions
@pytest.mark.parametrize(("mu", "slip"), [(0.0, 2.0), (0.5, 1.625), (4.0, 0.0)])
def test_a_contact_holds_the_slip_with_up_to_mu_lam(real, mu, slip):
    """It went 2 along a plane and 0.75 into it."""
    lam, move = project_one_contact(real, [[0.0, 0.5, 0]], [[2.0, -0.75, 0]], [1], (0, 1, 0), 0.0, 0.0, mu=mu)
    assert lam == 0.75
    np.testing.assert_allclose(move, [[slip - 2.0, 0.75, 0]], atol=tolerance(real))


def slide(real, mu, e, speed):
    """A particle of 1 kg that came down on a plane at (2, -1) m/s; the projection has left it (speed, 0)."""
    v = np.array([[speed, 0.0, 0]])
    out = run(
        bounce, real, 1, 9.0, 9.0, np.array([mu]), np.array([e]), 0.5, 1.0, np.zeros((1, 3)), v, np.ones(1),
        np.array([1]), np.array([[0, -1]]), np.array([[0.0, 1, 0]]), None, np.array([0.25]),
        np.array([[2.0, -1.0, 0]]), np.array([1]), np.zeros((1, 3)),
    )  # fmt: skip
    return (v + out[-1])[0]


@both_precisions
def test_particles_that_part_are_not_pulled_back(real):
    """They overlapped and move apart: what the projection added goes, but nothing beyond."""
    v = np.array([[3.0, 0, 0], [-3.0, 0, 0]])
    out = run(
        bounce, real, 1, 0.0, 1.0, np.zeros(0), np.zeros(0), 0.0, 1.0, np.array([[1.0, 0, 0], [0, 0, 0]]), v,
        np.ones(2), np.array([1]), np.array([[0, 1]]), np.zeros((1, 3)), None, np.array([0.5]),
        np.array([[0.5, 0, 0], [-0.5, 0, 0]]), np.array([1, 1]), np.zeros((2, 3)),
    )  # fmt: skip
    np.testing.assert_array_equal(v + out[-1], 0.0)


@both_precisions
@pytest.mark.parametrize(("mu", "kept"), [(0.0, 1.5), (0.25, 1.375), (9.0, 0.0)])
def test_a_bounce_has_friction_for_its_own_impulse(real, mu, kept):
    np.testing.assert_allclose(slide(real, mu, 0.5, 1.5), [kept, 0.5, 0], atol=tolerance(real))
    np.testing.assert_allclose(slide(real, mu, 0.0, 1.5), [1.5, 0, 0], atol=tolerance(real))


@pytest.mark.parametrize(
    ("kind", "x", "u", "normal", "gap"),
    [
        (0, [0.0, 1, 0], [0.0, -2, 0], [0, 1, 0], 0.75),  # through the plane y = 0
        (0, [0.0, -1, 0], [0.0, 0, 0], [0, 1, 0], -1.25),  # starts behind it
        (1, [-3.0, 0, 0], [6.0, 0, 0], [-1, 0, 0], 1.75),  # through the unit sphere: the entry point
        (1, [0.0, 0.5, 0], [0.0, 0, 0], [0, 1, 0], -0.75),  # starts inside: the closest point
        (1, [0.0, 0, 0], [0.0, 0, 0], [1, 0, 0], -1.25),  # its very centre
    ],
)
@both_precisions
def test_find_collider_contacts(real, kind, x, u, normal, gap):
    out = run(
        find_collider_contacts, real, 1, np.zeros(1, np.int32), np.array([kind]), np.zeros((1, 3)),
        np.array([[0.0, 1, 0]]), np.ones(1),
        np.array([0.25]), 0.05, -1.0, np.array([x]), np.ones(1), np.array([u]), np.zeros(1, np.int32),
        np.full((2, 2), 7), np.zeros((2, 3)), np.zeros(2), np.zeros(1, np.int32),
    )  # fmt: skip
    count, pair, normals, gaps, share = out[-5:]
    assert count == share == 1
    np.testing.assert_array_equal(pair[0], [0, -1])
    np.testing.assert_allclose(normals[0], normal, atol=tolerance(real))
    np.testing.assert_allclose(gaps[0], gap, atol=tolerance(real))


def test_find_collider_contacts_passes_over_what_is_far_or_fixed():
    x = np.array([[0.0, 9, 0], [0, -1, 0]])
    out = run(
        find_collider_contacts, "float64", 2, np.zeros(1, np.int32), np.array([0]), np.zeros((1, 3)),
        np.array([[0.0, 1, 0]]), np.zeros(1),
        np.full(2, 0.25), 0.05, -1.0, x, np.array([1.0, 0.0]), np.zeros((2, 3)), np.zeros(1, np.int32),
        np.full((2, 2), 7), np.zeros((2, 3)), np.zeros(2), np.zeros(2, np.int32),
    )  # fmt: skip
    assert out[-5] == 0
