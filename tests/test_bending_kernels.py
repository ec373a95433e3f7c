"""Bending energy's derivatives against differences, its discrete gradient against what that has to conserve."""

import numpy as np
import pytest
import warp as wp
from bending_energy import energy, slopes

from pbd_warp.kernels import bending
from pbd_warp.kernels.bending_row import exact_derivatives, mean_derivatives
from pbd_warp.model.bending import FOLDED, ROUNDED

turning, discrete_gradient = bending.turning[wp.float64], bending.discrete_gradient[wp.float64]
LENGTH = 1.0
"""Of the l that a kernel is given; the energies are those of B / l = 1."""


@wp.kernel(enable_backward=False)
def evaluate(
    f: wp.array2d[wp.vec3d],
    e: wp.array2d[wp.vec3d],
    rest: wp.float64,
    D: wp.array2d[wp.vec3d],
    mean_D: wp.array2d[wp.vec3d],
    H: wp.array2d[wp.mat33d],
    mean_H: wp.array2d[wp.mat33d],
    part: wp.array2d[wp.mat33d],
):
    q = wp.tid()
    length = wp.float64(1.0)
    D1, D2, H11, H12, H22 = exact_derivatives(e[q, 0], e[q, 1], length, rest)
    D[q, 0] = D1
    D[q, 1] = D2
    H[q, 0] = H11
    H[q, 1] = H12
    H[q, 2] = wp.transpose(H12)
    H[q, 3] = H22
    M1, M2, M11, M12, M21, M22 = mean_derivatives(f[q, 0], f[q, 1], e[q, 0], e[q, 1], length, rest)
    mean_D[q, 0] = M1
    mean_D[q, 1] = M2
    mean_H[q, 0] = M11
    mean_H[q, 1] = M12
    mean_H[q, 2] = M21
    mean_H[q, 3] = M22
    J1, J2, _moment, P = turning(e[q, 0], e[q, 1], length, rest)
    part[q, 0] = J1
    part[q, 1] = J2
    part[q, 2] = P
    G1, G2 = discrete_gradient(f[q, 0], f[q, 1], e[q, 0], e[q, 1], length, rest)
    D[q, 2] = G1
    D[q, 3] = G2


def run(f, e, rest=0.0):
    """D, the discrete D twice, H, the discrete H, the Gauss-Newton part, of pairs of links [m, 6]."""
    m = len(e)
    arrays = [
        wp.zeros((m, k), dtype=t) for k, t in [(4, wp.vec3d), (2, wp.vec3d), *[(4, wp.mat33d)] * 2, (3, wp.mat33d)]
    ]
    pairs = [wp.array(np.reshape(each, (m, 2, 3)), dtype=wp.vec3d) for each in (f, e)]
    wp.launch(evaluate, dim=m, inputs=[*pairs, rest, *arrays])
    D, mean_D, H, mean_H, part = (array.numpy() for array in arrays)
    J = np.concatenate([part[:, 0], part[:, 1]], axis=2)
    return (
        D[:, :2].reshape(m, 6),
        D[:, 2:].reshape(m, 6),
        mean_D.reshape(m, 6),
        square(H),
        square(mean_H),
        (J, part[:, 2]),
    )


def square(blocks):
    return blocks.reshape(-1, 2, 2, 3, 3).transpose(0, 1, 3, 2, 4).reshape(-1, 6, 6)


def links(rng, count=40):
    """Random pairs of unequal links, none of which turns back by more than some 130 degrees."""
    e = np.array([0.7, 0, 0, 0.9, 0, 0]) + rng.normal(size=(20 * count, 6))
    l1, l2 = np.linalg.norm(e[:, :3], axis=1), np.linalg.norm(e[:, 3:], axis=1)
    c = np.sum(e[:, :3] * e[:, 3:], axis=1) / (l1 * l2)
    return e[(c > -0.6) & (l1 > 0.3) & (l2 > 0.3)][:count]


rests = pytest.mark.parametrize("rest", [0.0, 0.3, 2.0])


@rests
def test_derivatives_are_those_of_the_energy(rng, rest):
    e = links(rng)
    D, _, _, H, _, _ = run(e, e, rest)
    slope = slopes(lambda at: energy(at[:, :3], at[:, 3:], rest), e)
    np.testing.assert_allclose(D, slope, rtol=1e-7, atol=1e-7)
    curve = slopes(lambda at: run(at, at, rest)[0], e)
    np.testing.assert_allclose(H, curve, rtol=1e-6, atol=1e-6 * np.abs(curve).max())
    np.testing.assert_allclose(H, H.transpose(0, 2, 1), atol=1e-12 * np.abs(H).max())


@rests
def test_the_discrete_gradient_does_exactly_the_work(rng, rest):
    """Also where both links change their length; and it turns nothing: e1 x D1 + e2 x D2 = 0 at the middle."""
    f, e = links(rng), links(rng)[::-1]
    _, D, same, _, H, _ = run(f, e, rest)
    gain = energy(e[:, :3], e[:, 3:], rest) - energy(f[:, :3], f[:, 3:], rest)
    size = np.abs(gain) + energy(e[:, :3], e[:, 3:], rest) + np.sum(np.abs(D * (e - f)), axis=1)
    np.testing.assert_array_less(np.abs(np.sum(D * (e - f), axis=1) - gain), 1e-14 * size)
    middle = 0.5 * (e + f)
    torque = np.cross(middle[:, :3], D[:, :3]) + np.cross(middle[:, 3:], D[:, 3:])
    np.testing.assert_allclose(torque, 0.0, atol=1e-13 * np.abs(D).max() * np.abs(middle).max())
    np.testing.assert_allclose(D, same, rtol=1e-12, atol=1e-13)
    curve = slopes(lambda at: run(f, at, rest)[2], e)
    np.testing.assert_allclose(H, curve, rtol=1e-6, atol=1e-6 * np.abs(curve).max())


@rests
def test_without_a_move_the_discrete_gradient_is_the_gradient(rng, rest):
    e = links(rng)
    D, discrete, _, _, _, _ = run(e, e, rest)
    np.testing.assert_allclose(discrete, D, rtol=1e-11, atol=1e-12)


def test_the_part_that_is_never_negative(rng):
    """J is the derivative of kb; J^T H J is the second derivative but for what is of order kb, and not negative."""
    e = links(rng)

    def binormal(at):
        a, b = at[:, :3], at[:, 3:]
        product = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
        return 2.0 * np.cross(a, b) / (product + np.sum(a * b, axis=1))[:, None]

    J, P = run(e, e)[5]
    np.testing.assert_allclose(J, slopes(binormal, e), rtol=1e-6, atol=1e-7)
    np.testing.assert_array_equal(P, np.broadcast_to(np.eye(3), P.shape))
    straight = np.concatenate([e[:, :3], 0.5 * e[:, :3]], axis=1)
    _, _, _, H, _, (J, P) = run(straight, straight)
    np.testing.assert_allclose(J.transpose(0, 2, 1) @ P @ J, H, atol=1e-12 * np.abs(H).max())
    for rest in (0.3, 2.0):
        _, _, _, H, _, (J, P) = run(e, e, rest)
        assert np.linalg.eigvalsh(J.transpose(0, 2, 1) @ P @ J).min() > -1e-12 * np.abs(J).max() ** 2
        # At rest, where there is no force, it is the second derivative.
        turn = np.arctan(0.5 * rest) * 2.0
        bent = np.array([[1.0, 0, 0, 0.7 * np.cos(turn), 0.7 * np.sin(turn), 0]])
        D, _, _, H, _, (J, P) = run(bent, bent, rest)
        np.testing.assert_allclose(D, 0.0, atol=1e-14)
        np.testing.assert_allclose(J.transpose(0, 2, 1) @ P @ J, H, atol=1e-12)


def test_at_rest_a_bent_curve_is_as_stiff_as_a_straight_one():
    """Per curvature: E l / B grows by half of the square of what is added to |kb|."""
    rest, more = 0.5, 1e-4

    def at(kb):
        turn = 2.0 * np.arctan(0.5 * kb)
        return energy(np.array([1.0, 0, 0]), np.array([np.cos(turn), np.sin(turn), 0]), rest)

    assert at(rest) == pytest.approx(0.0, abs=1e-30)
    assert (at(rest + more) + at(rest - more)) / more**2 == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("rest", [0.0, 0.5])
def test_what_is_singular_is_finite(rest):
    """Links that fold back, of no length, tiny and huge ones, exactly straight ones."""
    x = [1.0, 0, 0]
    cases = [
        [*x, -1.0, 0, 0],
        [*x, -1.0, 1e-9, 0],
        [*x, -1.0, 0.01, 0],
        [*x, 0, 0, 0],
        [0.0] * 6,
        [1e-12, 0, 0, 0, 1e-12, 0],
        [1e9, 0, 0, 0, 1e9, 0],
        [*x, 2.0, 0, 0],
    ]
    e = np.array(cases)
    straight = np.tile([1.0, 0, 0, 1, 0, 0], (len(e), 1))
    for f in (e, straight, e[::-1]):
        for result in (*run(f, e, rest)[:5], *run(f, e, rest)[5]):
            assert np.isfinite(result).all()


def test_the_host_s_energy_is_rounded_where_the_kernels_is():
    """Data does not import kernels, so both say it."""
    assert float(bending.FOLD) == FOLDED
    assert float(bending.ROUNDED) == ROUNDED
