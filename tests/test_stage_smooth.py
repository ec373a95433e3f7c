"""Bezier curves that are smooth at their knots stay smooth, and those with corners keep them free."""

import numpy as np
import pytest
from pxr import Usd
from stages import add_curves, local, new_stage

from pbd_warp.curves import load_stage, simulate
from pbd_warp.curves.basis import BasisKind
from pbd_warp.curves.fit import Fit
from pbd_warp.curves.sampling import Sampling


def smooth_bezier(knots, closed=False, corner=None):
    """Control points through knots [n, 3], with handles of unlike lengths in line at each but for one corner."""
    around = (np.roll(knots, -1, axis=0) - np.roll(knots, 1, axis=0)) / 2
    tangent = around if closed else np.gradient(knots, axis=0)
    out = []
    for k in range(len(knots) - (0 if closed else 1)):
        nxt = (k + 1) % len(knots)
        out += [knots[k], knots[k] + 0.4 * tangent[k], knots[nxt] - 0.2 * tangent[nxt]]
    out = np.array(out if closed else [*out, knots[-1]])
    if corner is not None:
        out[3 * corner + 1] = knots[corner] + (0.0, 0.1, 0.05)
    return out


def angles(points, closed=False):
    """Between the handles at the inner knots of one curve, in degrees."""
    points = np.asarray(points, np.float64)
    at = 3 * np.arange(0 if closed else 1, len(points) // 3)
    a, b = points[at] - points[at - 1], points[(at + 1) % len(points)] - points[at]
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)))


def wave(n, closed):
    t = np.linspace(0.0, 1.0, n, endpoint=not closed)
    if closed:
        return np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t), 0.2 * np.sin(4 * np.pi * t)], axis=1)
    return np.stack([t, 0.2 * np.sin(6 * t), 0.1 * np.cos(5 * t)], axis=1)


@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic"])
def test_what_is_smooth_stays_smooth_while_it_swings(wrap, tmp_path):
    closed = wrap == "periodic"
    stage = new_stage(tmp_path / "s.usda", last=48)
    points = smooth_bezier(wave(7, closed), closed)
    both = np.concatenate([points, points + np.array([0, 0, 1])])
    add_curves(stage, "/World/S", both, [len(points)] * 2, "bezier", wrap)
    stage.Save()
    simulate(load_stage(tmp_path / "s.usda"), tmp_path / "o.usda")
    result = Usd.Stage.Open(str(tmp_path / "o.usda"))
    farthest = 0.0
    for frame in range(49):
        shown = local(result, "/World/S", frame)
        for curve in np.split(shown, 2):
            assert angles(curve, closed).max() < 0.05, "in degrees: what float32 leaves of a straight angle"
        farthest = max(farthest, np.abs(shown - local(stage, "/World/S", 0)).max())
    assert farthest > 0.5, "it did swing"


def test_a_corner_is_free_and_the_others_are_not(tmp_path):
    stage = new_stage(tmp_path / "s.usda", last=30)
    points = smooth_bezier(wave(7, False), corner=3)
    add_curves(stage, "/World/S", points, basis="bezier")
    stage.Save()
    simulate(load_stage(tmp_path / "s.usda"), tmp_path / "o.usda")
    found = angles(local(Usd.Stage.Open(str(tmp_path / "o.usda")), "/World/S", 30))
    assert np.delete(found, 2).max() < 0.05
    before = angles(points)
    assert abs(found[2] - before[2]) > 5.0


def fitted(pinned, rng, points):
    sampling = Sampling(BasisKind("bezier", "nonperiodic", np.array([len(points)]), points), np.ones(1, bool))
    mask = np.zeros(sampling.count, bool)
    mask[pinned] = True
    displacement = 0.1 * rng.normal(size=(sampling.count, 3))
    return sampling, displacement, Fit(sampling, mask)(displacement)


def test_pinned_points_come_before_smoothness(rng):
    """Also where they leave no room for it: all four points of a segment and of the next one."""
    points = smooth_bezier(wave(4, False))
    sampling, displacement, moved = fitted(np.arange(7), rng, points)
    np.testing.assert_allclose(sampling.points(moved)[:7], displacement[:7], atol=1e-6)
    assert angles(points + moved)[0] > 1.0
    assert angles(points + moved)[1] < 0.01


def test_affine_motion_is_exact(rng):
    points = smooth_bezier(wave(6, False))
    sampling = Sampling(BasisKind("bezier", "nonperiodic", np.array([len(points)]), points), np.ones(1, bool))
    matrix, offset = rng.normal(size=(3, 3)), rng.normal(size=3)
    moved = points @ matrix + offset
    fit = Fit(sampling, np.zeros(sampling.count, bool))
    np.testing.assert_allclose(fit(sampling.points(moved)), moved, atol=1e-9)


def test_lengths_come_out_near_what_the_rope_had(tmp_path):
    """Smoothness costs some of the fit: the curve is as long as the rope to a hundredth."""
    stage = new_stage(tmp_path / "s.usda", last=24)
    add_curves(stage, "/World/S", smooth_bezier(wave(9, False)), basis="bezier")
    stage.Save()
    source = load_stage(tmp_path / "s.usda")
    simulate(source, tmp_path / "o.usda")
    (curves,) = source.curves
    shown = curves.sampling.points(local(Usd.Stage.Open(str(tmp_path / "o.usda")), "/World/S", 24))

    def length(x):
        return np.linalg.norm(np.diff(x, axis=0), axis=1).sum()

    assert length(shown) == pytest.approx(length(curves.x), rel=1e-2)
