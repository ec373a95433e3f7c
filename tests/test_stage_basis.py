"""Bases of cubic curves: what they evaluate to, and that the fit gives control points back."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom

from pbd_warp.curves.basis import LINKS, BasisKind
from pbd_warp.curves.fit import Fit
from pbd_warp.curves.sampling import Sampling, Weights


def kind_of(basis, wrap, counts):
    """Curves whose points are all different, with a corner at each."""
    counts = np.asarray(counts)
    number = np.arange(max(counts.sum(), 0))
    return BasisKind(basis, wrap, counts, np.stack([1.0 * number, number % 2, number % 5], axis=1))


def sampling_of(basis, wrap, counts):
    return Sampling(kind_of(basis, wrap, counts), np.ones(len(counts), bool))


def dense(weights: Weights, n):
    return weights(np.eye(n))


def control_matrix(basis, wrap, n):
    """What takes the control points of one curve to its simulation points."""
    return dense(sampling_of(basis, wrap, [n]).points, n)


CUBIC = [
    ("bezier", "nonperiodic", 4),
    ("bezier", "nonperiodic", 13),
    ("bezier", "periodic", 3),
    ("bezier", "periodic", 9),
]
CUBIC += [("bezier", "pinned", 7)]
CUBIC += [(basis, "nonperiodic", n) for basis in ("bspline", "catmullRom") for n in (4, 5, 11)]
CUBIC += [(basis, "periodic", n) for basis in ("bspline", "catmullRom") for n in (3, 4, 8)]
CUBIC += [(basis, "pinned", n) for basis in ("bspline", "catmullRom") for n in (2, 3, 7)]


def de_boor(points, segment, t):
    """A uniform cubic B-spline at t in a segment, by repeated interpolation between knots."""
    d = [points[segment + k].copy() for k in range(4)]
    for r in range(1, 4):
        for j in range(3, r - 1, -1):
            alpha = (t + 3 - j) / (4 - r)
            d[j] = (1 - alpha) * d[j - 1] + alpha * d[j]
    return d[3]


def de_casteljau(points, segment, t):
    d = points[3 * segment : 3 * segment + 4]
    while len(d) > 1:
        d = (1 - t) * d[:-1] + t * d[1:]
    return d[0]


def hermite(points, segment, t):
    """Catmull-Rom: through P_1 and P_2, with half the way between their neighbours as tangents."""
    before, a, b, after = points[segment : segment + 4]
    h = np.array([2 * t**3 - 3 * t**2 + 1, -2 * t**3 + 3 * t**2, t**3 - 2 * t**2 + t, t**3 - t**2])
    return h @ np.stack([a, b, (b - before) / 2, (after - a) / 2])


@pytest.mark.parametrize(
    ("basis", "n", "evaluate"), [("bezier", 10, de_casteljau), ("bspline", 7, de_boor), ("catmullRom", 7, hermite)]
)
def test_simulation_points_lie_on_the_curve(rng, basis, n, evaluate):
    points = rng.normal(size=(n, 3))
    segments = (n - 4) // (3 if basis == "bezier" else 1) + 1
    expected = [evaluate(points, s, k / LINKS) for s in range(segments) for k in range(LINKS)]
    expected.append(evaluate(points, segments - 1, 1.0))
    np.testing.assert_allclose(control_matrix(basis, "nonperiodic", n) @ points, expected, atol=1e-14)


@pytest.mark.parametrize("basis", ["bspline", "catmullRom"])
def test_pinned_curves_begin_and_end_in_their_control_points(rng, basis):
    points = rng.normal(size=(5, 3))
    ends = (control_matrix(basis, "pinned", 5) @ points)[[0, -1]]
    np.testing.assert_allclose(ends, points[[0, -1]], atol=1e-14)


@pytest.mark.parametrize(("basis", "wrap", "n"), CUBIC)
def test_segments_are_as_many_as_usd_says(basis, wrap, n):
    stage = Usd.Stage.CreateInMemory()
    curves = UsdGeom.BasisCurves.Define(stage, "/C")
    curves.CreateTypeAttr("cubic")
    curves.CreateBasisAttr(basis)
    curves.CreateWrapAttr(wrap)
    curves.CreateCurveVertexCountsAttr([n])
    assert list(kind_of(basis, wrap, [n]).segments) == list(curves.ComputeSegmentCounts(0))
    sampling = sampling_of(basis, wrap, [n])
    assert sampling.count == LINKS * curves.ComputeSegmentCounts(0)[0] + (wrap != "periodic")


@pytest.mark.parametrize(("basis", "wrap", "n"), CUBIC)
def test_weights_add_up_to_1_and_tell_all_control_points(basis, wrap, n):
    matrix = control_matrix(basis, wrap, n)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-14)
    assert np.linalg.cond(matrix) < 100.0
    sampling = sampling_of(basis, wrap, [n])
    np.testing.assert_allclose(sampling.varying.weight.sum(axis=1), 1.0, atol=1e-14)


@pytest.mark.parametrize(("basis", "wrap", "n"), [*CUBIC, ("linear", "nonperiodic", 5), ("linear", "periodic", 5)])
@pytest.mark.parametrize("pins", ["none", "root", "all"])
def test_the_fit_gives_back_what_control_points_did(rng, basis, wrap, n, pins):
    """Three curves of one prim, two of them alike; rest, then any motion of their control points."""
    more = n + 3 if basis == "bezier" else n + 1
    sampling = sampling_of(basis, wrap, [n, more, n])
    pinned = np.full(sampling.count, pins == "all")
    pinned[0] |= pins == "root"  # of the first curve only: alike in shape, not in pins
    fit = Fit(sampling, pinned)
    np.testing.assert_array_equal(fit(np.zeros((sampling.count, 3))), 0.0)
    moved = rng.normal(size=(2 * n + more, 3))
    np.testing.assert_allclose(fit(sampling.vertex(moved)), moved, atol=1e-8 if pins == "root" else 1e-12)


@pytest.mark.parametrize(
    ("basis", "wrap"), [(b, w) for b in ("bspline", "catmullRom") for w in ("nonperiodic", "pinned")]
)
def test_a_fit_goes_through_pinned_points_whatever_the_others_do(rng, basis, wrap):
    sampling = sampling_of(basis, wrap, [9])
    pinned = np.zeros(sampling.count, bool)
    pinned[[0, 7, -1]] = True
    displacement = rng.normal(size=(sampling.count, 3))
    fitted = sampling.vertex(Fit(sampling, pinned)(displacement))
    np.testing.assert_allclose(fitted[pinned], displacement[pinned], atol=1e-9)
    plain = sampling.vertex(Fit(sampling, np.zeros_like(pinned))(displacement))
    assert np.abs(plain - displacement)[pinned].max() > 0.05, "without the pins it would not"
    assert np.sum((plain - displacement) ** 2) < np.sum((fitted - displacement) ** 2), "and be nearer elsewhere"


def test_values_go_to_the_simulation_points_by_their_interpolation():
    sampling = sampling_of("bezier", "nonperiodic", [7, 4])
    np.testing.assert_allclose(sampling.varying(np.array([0.0, 3.0, 0.0, 1.0, 4.0])), [0, 1, 2, 3, 2, 1, 0, 1, 2, 3, 4])
    np.testing.assert_array_equal(sampling.uniform(np.array([1.0, 2.0])), [1] * 7 + [2] * 4)
    loop = sampling_of("bspline", "periodic", [3])
    np.testing.assert_allclose(loop.varying(np.array([0.0, 3.0, 6.0])), [0, 1, 2, 3, 4, 5, 6, 4, 2])


@pytest.mark.parametrize(
    ("basis", "wrap", "n", "message"),
    [
        ("linear", "nonperiodic", 1, "a nonperiodic linear curve needs 2 or more"),
        ("linear", "periodic", 2, "a periodic linear curve needs 3 or more"),
        ("bezier", "nonperiodic", 6, "a nonperiodic bezier curve needs 4, or 3 more, or 6 more"),
        ("bezier", "periodic", 7, "a periodic bezier curve needs 3, or 3 more"),
        ("bspline", "nonperiodic", 3, "it has 3 control points; a nonperiodic bspline curve needs 4 or more"),
        ("catmullRom", "pinned", 1, "needs 2 or more"),
    ],
)
def test_numbers_that_make_no_curve(basis, wrap, n, message):
    faults = kind_of(basis, wrap, [7 if wrap == "nonperiodic" else 6, n]).faults
    assert list(faults) == [1]
    assert message in faults[1]
