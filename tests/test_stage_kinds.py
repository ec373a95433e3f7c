"""NurbsCurves and HermiteCurves, as cubic ones; fits that grow with the length of curves, not with its power."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, UsdGeom, Vt
from scipy.interpolate import BSpline, CubicHermiteSpline
from stages import add_curves, line, local, new_stage, simulated, transform, world

import pbd_warp as pbd
from pbd_warp.curves import Material, load_stage
from pbd_warp.curves.basis import BasisKind
from pbd_warp.curves.fit import Fit
from pbd_warp.curves.hermite import HermiteKind
from pbd_warp.curves.nurbs import NurbsKind
from pbd_warp.curves.sampling import Sampling

DATA = Path(__file__).parent / "data" / "curves"


def clamped(n, order):
    inner = np.linspace(0, 1, n - order + 2)[1:-1]
    return np.concatenate([[0.0] * order, inner, [1.0] * order])


def uneven(n, order):
    return np.cumsum(1.0 + np.arange(n + order) % 3)


def doubled(n, order):
    knots = clamped(n, order)
    knots[order + 1] = knots[order]
    return knots


def nurbs_kind(counts, orders, knots, ranges=(), weights=(), points=None):
    counts = np.array(counts)
    points = np.arange(3.0 * counts.sum()).reshape(-1, 3) if points is None else points
    ranges = np.array(ranges if len(ranges) else np.zeros((0, 2)), float)
    return NurbsKind(counts, np.array(orders), np.concatenate(knots), ranges, np.array(weights, float), points)


def sampling_of(kind):
    assert not kind.faults
    return Sampling(kind, np.ones(len(kind.counts), bool))


NURBS = [(clamped, n, order) for n, order in ((4, 4), (9, 4), (7, 3), (5, 2), (8, 6))]
NURBS += [(uneven, 9, 4), (uneven, 6, 3), (doubled, 9, 4), (doubled, 12, 6)]


@pytest.mark.parametrize("rational", [False, True])
@pytest.mark.parametrize(("knots_of", "n", "order"), NURBS)
def test_nurbs_are_what_scipy_makes_of_them(rng, knots_of, n, order, rational):
    knots = knots_of(n, order)
    weights = rng.uniform(0.3, 3.0, n) if rational else np.ones(n)
    points = rng.normal(size=(n, 3))
    sampling = sampling_of(nurbs_kind([n], [order], [knots], weights=weights if rational else (), points=points))
    degree = order - 1
    spans = np.unique(knots[degree : n + 1])
    t = np.concatenate([*(a + (b - a) * np.arange(degree) / degree for a, b in pairwise(spans)), spans[-1:]])
    above = BSpline(knots, weights[:, None] * points, degree)(t)
    np.testing.assert_allclose(sampling.points(points), above / BSpline(knots, weights, degree)(t)[:, None], atol=1e-12)


def test_the_shown_range_of_a_nurbs_curve(rng):
    knots, points = clamped(9, 4), rng.normal(size=(9, 3))
    sampling = sampling_of(nurbs_kind([9], [4], [knots], ranges=[(0.25, 0.6)], points=points))
    spline = BSpline(knots, points, 3)
    np.testing.assert_allclose(sampling.points(points)[[0, -1]], spline([0.25, 0.6]), atol=1e-14)
    fit = Fit(sampling, np.zeros(sampling.count, bool))
    moved = fit(sampling.points(points))
    np.testing.assert_allclose(sampling.points(moved), sampling.points(points), atol=1e-5)
    assert np.abs(moved).max() < 10.0, "control points that hardly shape it do not fly away"


def test_hermite_curves_are_what_scipy_makes_of_them(rng):
    points, tangents = rng.normal(size=(2, 5, 3))
    sampling = sampling_of(HermiteKind(np.array([5])))
    t = np.arange(13) / 3
    expected = CubicHermiteSpline(np.arange(5.0), points, tangents)(t)
    np.testing.assert_allclose(sampling.points(np.concatenate([points, tangents])), expected, atol=1e-13)


KINDS = {
    "nurbs": lambda: nurbs_kind([9, 5], [4, 3], [clamped(9, 4), uneven(5, 3)]),
    "rational": lambda: nurbs_kind([9, 5], [4, 3], [clamped(9, 4), uneven(5, 3)], weights=np.linspace(0.5, 2.0, 14)),
    "hermite": lambda: HermiteKind(np.array([4, 2])),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pins", [[], [0], [0, -1]])
def test_the_fit_gives_back_what_control_values_did(rng, kind, pins):
    sampling = sampling_of(KINDS[kind]())
    pinned = np.zeros(sampling.count, bool)
    pinned[pins] = True
    moved = rng.normal(size=(sampling.value_count, 3))
    np.testing.assert_allclose(Fit(sampling, pinned)(sampling.points(moved)), moved, atol=1e-8)


def test_a_periodic_nurbs_curve_is_a_loop(rng):
    """As exporters write it: uniform knots, and the first control points once more at the end."""
    own = rng.normal(size=(6, 3))
    points = np.concatenate([own, own[:3]])
    sampling = sampling_of(nurbs_kind([9], [4], [np.arange(13.0)], points=points))
    assert sampling.closed.all()
    assert sampling.count == 18
    assert len(sampling.edges) == 18
    assert [17, 0] in sampling.edges.tolist()
    moved = np.concatenate([(change := rng.normal(size=(6, 3))), change[:3]])
    fitted = Fit(sampling, np.zeros(18, bool))(sampling.points(moved))
    np.testing.assert_allclose(fitted, moved, atol=1e-10)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"knots": [np.zeros(7)]}, "knots must be 8 for its curves, but there are 7"),
        ({"weights": [1.0]}, "pointWeights must be 4 for its curves, but there are 1"),
        ({"orders": [4, 4]}, "order must be 1 for its curves, but there are 2"),
    ],
)
def test_nurbs_that_do_not_add_up(change, message):
    with pytest.raises(pbd.InputError, match=message):
        nurbs_kind(**{"counts": [4], "orders": [4], "knots": [clamped(4, 4)], **change})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"knots": [clamped(4, 4)[::-1]]}, "its knots do not rise"),
        ({"orders": [5], "knots": [np.arange(9.0)]}, "it has 4 control points and order 5"),
        ({"weights": [1.0, 0.0, 1.0, 1.0]}, "its pointWeights are not above 0"),
        ({"ranges": [(0.5, 2.0)]}, "its range 0.5 to 2 is not within its knots from 0 to 1"),
        ({"counts": [8], "knots": [[0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2]]}, "a knot within it is there 4 times"),
    ],
)
def test_nurbs_that_make_no_curve(change, message):
    kind = nurbs_kind(**{"counts": [4], "orders": [4], "knots": [clamped(4, 4)], **change})
    assert message in kind.faults[0]


def put_nurbs(stage, path, points, knots, weights=None):
    curves = UsdGeom.NurbsCurves.Define(stage, path)
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    curves.CreateCurveVertexCountsAttr([len(points)])
    curves.CreateOrderAttr([4])
    curves.CreateKnotsAttr(Vt.DoubleArray(list(knots)))
    curves.CreateRangesAttr([Gf.Vec2d(knots[3], knots[-4])])
    if weights is not None:
        curves.CreatePointWeightsAttr(list(map(float, weights)))
    curves.CreateWidthsAttr([0.02])
    curves.SetWidthsInterpolation("constant")
    curves.CreateExtentAttr(UsdGeom.Curves.ComputeExtent(curves.GetPointsAttr().Get(), [0.02]))
    return curves


@pytest.mark.parametrize("weights", [None, [1, 1, 2, 1, 1, 1, 1]])
def test_a_nurbs_curve_hangs_from_its_root(tmp_path, weights):
    stage = new_stage(tmp_path / "a.usda", up="Z", metres=0.01)
    parent = UsdGeom.Xform.Define(stage, "/World/P")
    transform(parent, (30, 0, 0), (0, 20, 0), (2, 2, 2))
    put_nurbs(stage, "/World/P/C", line(7, (0, 0, 0), (50, 0, 10)), clamped(7, 4), weights)
    stage.Save()
    result, source, stats = simulated(tmp_path / "a.usda")
    before = world(stage, "/World/P/C", 0)
    np.testing.assert_array_equal(local(result, "/World/P/C", 0), local(stage, "/World/P/C", 0))
    (curves,) = source.curves
    for time_code in (10, 23):
        x = curves.sampling.points(world(result, "/World/P/C", time_code))
        np.testing.assert_allclose(x[0], before[0], atol=1e-6)
        length = np.linalg.norm(np.diff(x, axis=0), axis=1).sum()
        assert length == pytest.approx(np.linalg.norm(before[-1] - before[0]), rel=0.1)
    assert world(result, "/World/P/C", 10)[-1, 2] < before[-1, 2] - 0.1
    assert stats.max_stretch < 1e-4


def test_a_hermite_curve_hangs_from_its_root_with_its_tangents(tmp_path):
    """A segment of it can do what one of a bezier can, so it does the same."""
    points, tangents = np.array([(0, 0, 0), (0.8, 0.1, 0.1)]), np.array([(0.9, 0.6, 0), (0.6, -0.4, 0.3)])
    bezier = np.stack([points[0], points[0] + tangents[0] / 3, points[1] - tangents[1] / 3, points[1]])
    stage = new_stage(tmp_path / "a.usda")
    parent = UsdGeom.Xform.Define(stage, "/World/P")
    move, turn = parent.AddTranslateOp(), parent.AddRotateZOp()
    for time_code in range(24):
        move.Set(Gf.Vec3d(0.01 * time_code, 0, 0), time_code)
        turn.Set(2.0 * time_code, time_code)
    add_curves(stage, "/World/P/Bezier", bezier, basis="bezier")
    curves = UsdGeom.HermiteCurves.Define(stage, "/World/P/Hermite")
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    curves.CreateTangentsAttr(Vt.Vec3fArray.FromNumpy(tangents.astype(np.float32)))
    curves.CreateCurveVertexCountsAttr([2])
    curves.CreateWidthsAttr([0.02])
    curves.SetWidthsInterpolation("constant")
    curves.CreateExtentAttr(UsdGeom.Curves.ComputeExtent(curves.GetPointsAttr().Get(), [0.02]))
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda", dtype="float64")
    for time_code in range(24):
        b = local(result, "/World/P/Bezier", time_code)
        h = local(result, "/World/P/Hermite", time_code)
        t = local(result, "/World/P/Hermite", time_code, "tangents")
        np.testing.assert_allclose(h, b[::3], atol=2e-5)  # of control points rounded to float32, after 1 s
        np.testing.assert_allclose(t, np.array([3 * (b[1] - b[0]), 3 * (b[3] - b[2])]), atol=1e-4)
        v = [local(result, f"/World/P/{name}", time_code, "velocities") for name in ("Hermite", "Bezier")]
        np.testing.assert_allclose(v[0], v[1][::3], atol=2e-3)
    assert np.abs(local(result, "/World/P/Hermite", 23) - points).max() > 0.3


def test_the_factors_of_a_fit_grow_with_the_length_of_the_curve():
    def entries(n, wrap, pinned_every):
        kind = BasisKind("bspline", wrap, np.array([n]), np.arange(3.0 * n).reshape(-1, 3))
        sampling = sampling_of(kind)
        fit = Fit(sampling, np.arange(sampling.count) % pinned_every == 0)
        return fit._factors.nnz / n

    for wrap in ("nonperiodic", "periodic", "pinned"):
        for pinned_every in (5, 10**9):
            assert entries(20000, wrap, pinned_every) < 1.2 * entries(500, wrap, pinned_every)


def test_a_bspline_of_twenty_thousand_points_comes_back(rng):
    n = 20000
    sampling = sampling_of(BasisKind("bspline", "nonperiodic", np.array([n]), np.arange(3.0 * n).reshape(-1, 3)))
    moved = rng.normal(size=(n, 3))
    pinned = np.zeros(sampling.count, bool)
    pinned[0] = True
    np.testing.assert_allclose(Fit(sampling, pinned)(sampling.points(moved)), moved, atol=1e-8)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", ["smooth_hair", "short_first_link"])
def test_hairs_with_short_links(tmp_path, name, dtype):
    path = tmp_path / f"{name}.usda"
    path.write_text((DATA / f"{name}.usda").read_text())
    _, _, stats = simulated(path, dtype=dtype, check=False)
    assert stats.max_stretch < 1e-5


@pytest.mark.parametrize("pin", ["root", "ends", "none"])
def test_a_mixed_groom(tmp_path, pin):
    """Curves of many lengths in one prim, another of each type beside it."""
    stage = new_stage(tmp_path / "a.usda")
    counts = [4, 7, 5, 4, 12]
    points = np.concatenate(
        [line(n, (0, 0, k), (0.6, 0.3, k)) + 0.05 * np.sin(np.arange(n))[:, None] for k, n in enumerate(counts)]
    )
    add_curves(stage, "/World/Hair", points, counts, basis="bspline")
    put_nurbs(stage, "/World/Nurbs", line(6, (0, 0, 0), (1, 1, 0)) + 0.1 * np.eye(6, 3), clamped(6, 4))
    stage.Save()
    result, source, stats = simulated(tmp_path / "a.usda", pin=pin)
    assert not source.left
    assert np.isfinite(local(result, "/World/Hair", 23)).all()
    assert stats.max_stretch < 0.01
    model = load_stage(tmp_path / "a.usda", material=Material(pin)).scene.builder.finalize()
    assert np.sum(model.w == 0) == {"root": 6, "ends": 12, "none": 0}[pin]
