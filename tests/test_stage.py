"""Existing stages simulated: what comes back composes over them, exact where nothing moves, true where it does."""

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom
from stages import add_curves, line, local, new_stage, simulated, transform, world

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.curves import Material, load_stage, simulate
from pbd_warp.run import Hooks
from pbd_warp.step.integrators import INTEGRATORS
from pbd_warp.step.methods import METHODS

EPS = 1.2e-7
KINDS = [("linear", "nonperiodic", 6), ("linear", "periodic", 6), ("linear", "pinned", 6)]
KINDS += [("bezier", "nonperiodic", 7), ("bezier", "periodic", 6), ("bezier", "pinned", 7)]
KINDS += [(basis, wrap, 6) for basis in ("bspline", "catmullRom") for wrap in ("nonperiodic", "periodic", "pinned")]


def wavy(n, closed):
    """Control points of an open or closed curve that is nowhere straight."""
    angle = np.linspace(0, 2 * np.pi, n, endpoint=not closed) * (1.0 if closed else 0.6)
    return np.stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(3 * angle)], axis=1)


def rest_of_every_kind(path, **kwargs):
    """Two curves of every kind under parents that are moved, turned, scaled."""
    stage = new_stage(path, **kwargs)
    parent = UsdGeom.Xform.Define(stage, "/World/Turned")
    transform(parent, (30, -2, 7), (20, 70, -35), (1.5, 1.5, 1.5))
    uneven = UsdGeom.Xform.Define(stage, "/World/Turned/Uneven")
    transform(uneven, (0.1, 0.2, 0.3), (0, 0, 25), (0.5, 2.0, -1.0))
    paths = []
    for number, (basis, wrap, n) in enumerate(KINDS):
        paths.append(f"/World/Turned/Uneven/Kind{number}")
        points = wavy(n, wrap == "periodic")
        add_curves(stage, paths[-1], np.concatenate([points, points + 0.7]), [n, n], basis, wrap)
    stage.Save()
    return paths


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("up", ["Y", "Z"])
def test_without_gravity_and_motion_the_input_comes_back_exactly(tmp_path, up, dtype):
    paths = rest_of_every_kind(tmp_path / "rest.usda", up=up, metres=0.01)
    stage, _, stats = simulated(tmp_path / "rest.usda", gravity=0.0, dtype=dtype)
    before = Usd.Stage.Open(str(tmp_path / "rest.usda"))
    # Direct sees in float64 what the lengths were rounded by to float32; coordinates are up to 2.
    ulps = 4 * EPS if dtype == "float32" else 0.0
    for path in paths:
        for time_code in range(24):
            np.testing.assert_allclose(local(stage, path, time_code), local(before, path, 0), rtol=0, atol=ulps)
            still = local(stage, path, time_code, "velocities")
            np.testing.assert_allclose(still, 0.0, rtol=0, atol=ulps * 24 * 16)
    assert stats.max_stretch < 10 * EPS
    assert stats.frames == 24


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_at_rest_every_method_and_integrator_stays(tmp_path, method, integrator):
    stage = new_stage(tmp_path / "a.usda", last=9)
    rng = np.random.default_rng(1)
    points = np.cumsum(rng.uniform(-0.1, 0.3, (200, 3)), axis=0)
    add_curves(stage, "/World/Curves", points, [150, 50])
    stage.Save()
    settings = {"method": METHODS[method](iterations=3), "integrator": integrator, "substeps": 4}
    result, _, _ = simulated(tmp_path / "a.usda", gravity=0.0, settings=settings)
    np.testing.assert_array_equal(local(result, "/World/Curves", 9), local(stage, "/World/Curves", 0))


def test_a_z_up_centimetre_stage_is_the_y_up_metre_one(tmp_path):
    points = wavy(12, closed=False)
    to_z_up = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # row vectors: y becomes z, z becomes -y
    metres = new_stage(tmp_path / "y.usda")
    add_curves(metres, "/World/C", points)
    centimetres = new_stage(tmp_path / "z.usda", up="Z", metres=0.01)
    add_curves(centimetres, "/World/C", 100 * points @ to_z_up, width=2.0)
    metres.Save(), centimetres.Save()
    y, _, _ = simulated(tmp_path / "y.usda", dtype="float64")
    z, _, _ = simulated(tmp_path / "z.usda", dtype="float64")
    moved = 0.0
    for time_code in range(24):
        expected = 100 * local(y, "/World/C", time_code) @ to_z_up
        # What rounding the input's numbers to float32 does, and half a second of swinging makes of it.
        np.testing.assert_allclose(local(z, "/World/C", time_code), expected, atol=100 * 100 * EPS)
        fast = 100 * local(y, "/World/C", time_code, "velocities") @ to_z_up
        np.testing.assert_allclose(local(z, "/World/C", time_code, "velocities"), fast, atol=100 * 2000 * EPS)
        moved = max(moved, np.abs(expected - 100 * points @ to_z_up).max())
    assert moved > 50.0


@pytest.mark.parametrize("scale", [(2, 2, 2), (0.5, 4, 1.5), (1, 1, -1)], ids=["even", "uneven", "mirrored"])
def test_under_a_scaled_turned_parent_the_motion_in_the_world_is_the_same(tmp_path, scale):
    points = wavy(8, closed=False)
    plain = new_stage(tmp_path / "plain.usda")
    add_curves(plain, "/World/C", points)
    scaled = new_stage(tmp_path / "scaled.usda")
    parent = UsdGeom.Xform.Define(scaled, "/World/P")
    transform(parent, (1, 2, 3), (10, 20, 30), scale)
    matrix = np.array(parent.ComputeLocalToWorldTransform(0))
    inverse = np.linalg.inv(matrix)
    add_curves(scaled, "/World/P/C", points @ inverse[:3, :3] + inverse[3, :3])
    plain.Save(), scaled.Save()
    a, _, _ = simulated(tmp_path / "plain.usda", dtype="float64")
    b, _, _ = simulated(tmp_path / "scaled.usda", dtype="float64")
    for time_code in range(24):
        np.testing.assert_allclose(world(b, "/World/P/C", time_code), world(a, "/World/C", time_code), atol=200 * EPS)
        fast = local(b, "/World/P/C", time_code, "velocities") @ matrix[:3, :3]
        np.testing.assert_allclose(fast, local(a, "/World/C", time_code, "velocities"), atol=5000 * EPS)
    assert np.abs(world(a, "/World/C", 23) - points).max() > 0.5


def test_a_catenary_in_centimetres_under_a_turned_parent_hangs_still(tmp_path):
    """A known answer from end to end: up axis, units, transforms, lengths, equal masses and pins have to be right."""
    exact = references.catenary(20, 0.05, 0.6) @ np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # [m], z up
    stage = new_stage(tmp_path / "a.usda", up="Z", metres=0.01, last=47)
    parent = UsdGeom.Xform.Define(stage, "/World/P")
    transform(parent, (500, 20, 80), (15, -40, 75), (2, 2, 2))
    matrix = np.array(parent.ComputeLocalToWorldTransform(0))
    inverse = np.linalg.inv(matrix)
    add_curves(stage, "/World/P/C", 100 * exact @ inverse[:3, :3] + inverse[3, :3])
    stage.Save()
    result, _, stats = simulated(tmp_path / "a.usda", pin="ends")
    assert stats.method == "direct"
    for time_code in range(48):
        # Rounding of the parent's 5 m to float32, and what that bends.
        np.testing.assert_allclose(world(result, "/World/P/C", time_code), exact, atol=5 * 10 * EPS)


def animate(xform, last):
    """Goes round and turns, growing a little."""
    move, turn, size = xform.AddTranslateOp(), xform.AddRotateZOp(), xform.AddScaleOp()
    for time_code in range(last + 1):
        move.Set(Gf.Vec3d(np.sin(0.2 * time_code), 0.5, 0), time_code)
        turn.Set(3.0 * time_code, time_code)
        size.Set(Gf.Vec3f(1.0 + 0.01 * time_code), time_code)


@pytest.mark.parametrize(("basis", "n"), [("linear", 5), ("bezier", 7), ("bspline", 7), ("catmullRom", 7)])
def test_pins_follow_their_animated_parent(tmp_path, basis, n):
    stage = new_stage(tmp_path / "a.usda")
    parent = UsdGeom.Xform.Define(stage, "/World/P")
    animate(parent, 23)
    add_curves(stage, "/World/P/C", wavy(n, closed=False), basis=basis)
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda")
    (curves,) = source.curves
    for time_code in range(24):
        x = curves.sampling.vertex(local(result, "/World/P/C", time_code))
        x_start = curves.sampling.vertex(local(result, "/World/P/C", 0))
        v = curves.sampling.vertex(local(result, "/World/P/C", time_code, "velocities"))
        np.testing.assert_allclose(x[0], x_start[0], atol=4 * EPS)
        np.testing.assert_allclose(v[0], 0.0, atol=4 * EPS * 24)
        if basis == "linear":
            links = [np.linalg.norm(np.diff(world(result, "/World/P/C", t), axis=0), axis=1) for t in (0, time_code)]
            np.testing.assert_allclose(links[1], links[0], rtol=1e-5)
    assert np.abs(world(result, "/World/P/C", 23) - world(stage, "/World/P/C", 23)).max() > 0.1, "the rest lags behind"


def test_what_is_not_pinned_falls_in_the_world_whatever_its_parent_does(tmp_path):
    stage = new_stage(tmp_path / "a.usda", last=47, fps=48)
    animate(UsdGeom.Xform.Define(stage, "/World/P"), 47)
    path = "/World/P/C"
    add_curves(stage, path, line(4))
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda", pin="none", dtype="float64", settings={"substeps": 4})
    h = 1 / 48 / 4
    start = world(result, path, 0)
    for time_code in range(48):
        n = 4 * time_code
        expected = start - np.array([0, 9.81, 0]) * h * h * n * (n + 1) / 2  # semi-implicit steps, exactly
        np.testing.assert_allclose(world(result, path, time_code), expected, atol=100 * EPS)
        if time_code:
            # A point that goes on with its velocity in the local space that goes on: by the chain rule, from behind.
            matrices = [
                np.array(UsdGeom.Imageable.Get(result, path).ComputeLocalToWorldTransform(t))
                for t in (time_code - 1, time_code)
            ]
            change = (matrices[1] - matrices[0]) * 48
            points = local(result, path, time_code)
            v = local(result, path, time_code, "velocities") @ matrices[1][:3, :3]
            v += points @ change[:3, :3] + change[3, :3]
            np.testing.assert_allclose(v, [(0, -9.81 * n * h, 0)] * 4, atol=1e4 * EPS)


def test_pins_follow_points_that_are_animated(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line(5))
    for time_code in range(24):
        curves.GetPointsAttr().Set(
            line(5, (0, 0.05 * time_code, 0), (1, 0.05 * time_code, 0)).astype(np.float32), time_code
        )
    stage.Save()
    result, _, stats = simulated(tmp_path / "a.usda", pin="ends")
    for time_code in range(1, 24):
        points = local(result, "/World/C", time_code)
        np.testing.assert_allclose(points[[0, -1]], local(stage, "/World/C", time_code)[[0, -1]], atol=EPS)
        v = local(result, "/World/C", time_code, "velocities")[[0, -1]]
        np.testing.assert_allclose(v, [(0, 0.05 * 24, 0)] * 2, atol=100 * EPS)
    assert stats.max_stretch < 0.05


@pytest.mark.parametrize(("basis", "wrap", "n"), [kind for kind in KINDS if kind[1] != "periodic"])
def test_a_curve_keeps_its_pinned_end_and_its_length(tmp_path, basis, wrap, n):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", wavy(n, closed=False), basis=basis, wrap=wrap)
    stage.Save()
    result, source, stats = simulated(tmp_path / "a.usda")
    sampling = source.curves[0].sampling
    at = [sampling.vertex(local(result, "/World/C", time_code)) for time_code in range(24)]
    ends = np.array([x[[0, -1]] for x in at])
    np.testing.assert_allclose(ends[:, 0], np.tile(ends[0, 0], (24, 1)), atol=4 * EPS)
    assert np.linalg.norm(ends[-1, 1] - ends[0, 1]) > 0.2
    assert stats.max_stretch < 1e-4
    lengths = [np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in at]
    # Beziers and linear curves do what their points did. The others have fewer control points than simulation points,
    # 6 for 9 links, and cut the corners that they cannot make.
    near = 1e-4 if basis in ("linear", "bezier") else 0.15
    np.testing.assert_allclose(lengths, lengths[0], rtol=near)


@pytest.mark.parametrize("basis", ["linear", "bezier", "bspline", "catmullRom"])
def test_a_periodic_curve_is_a_loop(tmp_path, basis):
    stage = new_stage(tmp_path / "a.usda")
    points = wavy(9, closed=True)
    add_curves(stage, "/World/C", np.concatenate([points, points + 3]), [9, 9], basis, "periodic")
    stage.Save()
    result, source, stats = simulated(tmp_path / "a.usda")
    model = source.scene.builder.finalize()
    assert np.all(np.bincount(model.distance.edge.ravel()) == 2)
    assert len(np.unique(model.component)) == 2
    assert stats.max_stretch < 1e-4
    assert np.abs(local(result, "/World/C", 23) - local(stage, "/World/C", 0)).max() > 0.3
    assert np.isfinite(local(result, "/World/C", 23)).all()


def test_masses_and_widths(tmp_path):
    stage = new_stage(tmp_path / "a.usda", metres=0.1)
    transform(UsdGeom.Xform.Define(stage, "/World/P"), scale=(2, 2, 2))
    curves = add_curves(stage, "/World/P/C", np.concatenate([line(5), line(3) + 1]), [5, 3])
    values = {"constant": [0.3], "uniform": [0.1, 0.3], "vertex": np.linspace(0.1, 0.8, 8)}
    values["varying"] = values["vertex"]
    for interpolation, widths in values.items():
        curves.GetWidthsAttr().Set(list(map(float, widths)))
        curves.SetWidthsInterpolation(interpolation)
        stage.Save()
        model = load_stage(tmp_path / "a.usda", material=Material("none", density=500.0)).scene.builder.finalize()
        diameter = 0.2 * np.repeat(widths, {1: 8, 2: [5, 3], 8: 1}[len(widths)])
        np.testing.assert_allclose(2 * model.radius, diameter, rtol=1e-6)
        link = np.diff(np.concatenate([[0], 0.05 * np.arange(4), [0]]))
        squares = (diameter[:4] ** 2 + diameter[1:5] ** 2) / 2
        assert 1 / model.w[:5] @ np.ones(5) == pytest.approx(500 * np.pi / 4 * 0.05 * squares.sum(), rel=1e-5), link
    model = load_stage(tmp_path / "a.usda", material=Material("none", mass=3.0)).scene.builder.finalize()
    np.testing.assert_allclose(1 / model.w, [0.375, 0.75, 0.75, 0.75, 0.375, 0.75, 1.5, 0.75], rtol=1e-5)
    primvar = UsdGeom.PrimvarsAPI(curves).CreatePrimvar("widths", Sdf.ValueTypeNames.FloatArray, "constant")
    primvar.Set([0.7])
    stage.Save()
    model = load_stage(tmp_path / "a.usda").scene.builder.finalize()
    np.testing.assert_allclose(2 * model.radius, 0.14, rtol=1e-6)
    for name in ("widths", "primvars:widths"):
        curves.GetPrim().RemoveProperty(name)
    stage.Save()
    model = load_stage(tmp_path / "a.usda").scene.builder.finalize()
    np.testing.assert_allclose(2 * model.radius, 0.01)


def test_attributes_of_the_prim_and_the_command_line_before_them(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    prim = add_curves(stage, "/World/C", line(3)).GetPrim()
    plain = add_curves(stage, "/World/D", line(3, (0, 1, 0), (1, 1, 0))).GetPrim()
    for name, kind, value in (("pin", "Token", "ends"), ("mass", "Float", 4.0), ("compliance", "Double", 1e-3)):
        prim.CreateAttribute(f"pbd:{name}", getattr(Sdf.ValueTypeNames, name and kind)).Set(value)
    plain.CreateAttribute("pbd:density", Sdf.ValueTypeNames.Float).Set(2000.0)
    stage.Save()

    def model(**material):
        return load_stage(tmp_path / "a.usda", material=Material(**material)).scene.builder.finalize()

    bulk = np.pi / 4 * 0.02**2
    own = model()
    np.testing.assert_array_equal(own.w == 0, [1, 0, 1, 1, 0, 0])
    np.testing.assert_allclose(1 / own.w[[1, 4]], [2.0, 2000 * bulk / 2], rtol=1e-5)
    np.testing.assert_allclose(own.distance.compliance, [1e-3, 1e-3, 0, 0])
    said = model(pin="none", density=1000.0, compliance=0.0)
    assert not np.any(said.w == 0)
    np.testing.assert_allclose(1 / said.w[[1, 4]], 1000 * bulk / 2, rtol=1e-5)
    np.testing.assert_array_equal(said.distance.compliance, 0)


@pytest.mark.parametrize("interpolation", ["vertex", "uniform", "varying"])
def test_pins_by_a_primvar(tmp_path, interpolation):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", np.concatenate([wavy(7, False), wavy(7, False) + 2]), [7, 7], "bezier")
    primvar = UsdGeom.PrimvarsAPI(curves).CreatePrimvar("hold", Sdf.ValueTypeNames.FloatArray, interpolation)
    values = {"vertex": [1, 0, 0, 0, 0, 0, 0] + [0] * 6 + [1], "uniform": [0, 1], "varying": [0, 1, 0, 1, 0, 0]}
    pinned = {"vertex": [0, 13], "uniform": range(7, 14), "varying": [2, 3, 4, 7, 8]}
    primvar.Set(list(map(float, values[interpolation])))
    stage.Save()
    _, source, _ = simulated(tmp_path / "a.usda", pin="primvar:hold")
    if interpolation == "varying":  # linear between them: from 1/2 on, which is 2/3 of the way
        assert list(np.flatnonzero(source.curves[0].pinned)) == list(pinned["varying"])
    else:
        assert list(np.flatnonzero(source.curves[0].pinned)) == list(pinned[interpolation])


def test_colliders_keep_curves_out(tmp_path):
    stage = new_stage(tmp_path / "a.usda", up="Z", metres=0.01, last=47)
    add_curves(stage, "/World/C", line(30, (-40, 3, 60), (80, 3, 60)), width=2.0)
    transform(UsdGeom.Xform.Define(stage, "/World/Set"), (0, 0, 5), (0, 0, 30), (2, 2, 2))
    sphere = UsdGeom.Sphere.Define(stage, "/World/Set/Ball")
    sphere.CreateRadiusAttr(10.0)
    sphere.CreateExtentAttr([(-10, -10, -10), (10, 10, 10)])
    transform(sphere, (0, 0, 10))
    floor = UsdGeom.Plane.Define(stage, "/World/Set/Floor")
    floor.GetPrim().CreateAttribute("pbd:friction", Sdf.ValueTypeNames.Float).Set(0.5)
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", pin="none", collide=["/World/Set/*"])
    colliders = source.scene.builder.finalize().colliders
    np.testing.assert_allclose(colliders.friction, [0.0, 0.5])
    np.testing.assert_allclose(colliders.size, [[0.2, 0, 0], [0, 0, 1]], atol=1e-12)
    points = np.array([world(result, "/World/C", time_code) for time_code in range(48)])
    above, away = points[..., 2] - 0.05, np.linalg.norm(points - (0, 0, 0.25), axis=-1) - 0.2
    for gap in (above, away):
        assert gap.min() == pytest.approx(0.01, abs=1e-3), "as near as the radius lets it"


@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_planes_are_where_their_transform_puts_them(tmp_path, axis):
    stage = new_stage(tmp_path / "a.usda", metres=0.1)
    add_curves(stage, "/World/C", line(3, (0, 50, 0), (1, 50, 0)))
    transform(UsdGeom.Xform.Define(stage, "/World/P"), (1, 2, 3), (0, 0, 0), (1, 3, -0.5))
    plane = UsdGeom.Plane.Define(stage, "/World/P/Plane")
    plane.CreateAxisAttr(axis)
    transform(plane, (0, 1, 0), (20, 30, 40))
    stage.Save()
    source = load_stage(tmp_path / "a.usda", collide=["/World/P/Plane"])
    colliders = source.scene.builder.finalize().colliders
    matrix = plane.ComputeLocalToWorldTransform(0)
    corners = np.eye(3)[[k for k in range(3) if "XYZ"[k] != axis]]
    for corner in (np.zeros(3), *corners):
        there = 0.1 * np.array(matrix.Transform(Gf.Vec3d(*corner))) - source.origin
        assert (there - colliders.centre[0]) @ colliders.size[0] == pytest.approx(0, abs=1e-12)
    above = 0.1 * np.array(matrix.Transform(Gf.Vec3d(*np.eye(3)["XYZ".index(axis)]))) - source.origin
    assert (above - colliders.centre[0]) @ colliders.size[0] > 0.01
    assert np.linalg.norm(colliders.size[0]) == pytest.approx(1)


@pytest.mark.parametrize("fps", [24.0, 23.976, 29.97, 59.94])
def test_a_frame_is_at_every_time_code_to_the_last_bit(tmp_path, fps):
    stage = new_stage(tmp_path / "a.usda", first=1, last=2000, fps=fps)
    add_curves(stage, "/World/C", line(4))
    stage.Save()
    assert list(load_stage(tmp_path / "a.usda").timeline.time_codes) == list(range(1, 2001))


def test_time_codes_are_the_stages_own(tmp_path):
    stage = new_stage(tmp_path / "a.usda", first=101.5, last=110.5, fps=30)
    add_curves(stage, "/World/C", line(4))
    stage.Save()
    result, _, stats = simulated(tmp_path / "a.usda")
    points = UsdGeom.BasisCurves.Get(result, "/World/C").GetPointsAttr()
    assert points.GetTimeSamples() == [101.5 + n for n in range(10)]
    assert (result.GetStartTimeCode(), result.GetEndTimeCode(), result.GetTimeCodesPerSecond()) == (101.5, 110.5, 30)
    result, _, stats = simulated(tmp_path / "a.usda", tmp_path / "twice.usda", fps=60)
    points = UsdGeom.BasisCurves.Get(result, "/World/C").GetPointsAttr()
    assert points.GetTimeSamples() == [101.5 + n / 2 for n in range(19)]
    result, _, stats = simulated(tmp_path / "a.usda", tmp_path / "longer.usda", frames=20)
    assert result.GetEndTimeCode() == 120.5
    assert stats.frames == 20
    result, _, stats = simulated(tmp_path / "a.usda", tmp_path / "shorter.usda", frames=4)
    assert result.GetEndTimeCode() == 110.5, "what else moves in the stage goes on"


def test_interrupted_the_frames_so_far_are_kept(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line(4))
    stage.Save()

    def stop(done):
        if done == 7:
            raise KeyboardInterrupt

    with pytest.raises(pbd.PbdError, match=r"interrupted; the 7 frames so far are in .*out\.usda"):
        simulate(load_stage(tmp_path / "a.usda"), tmp_path / "out.usda", hooks=Hooks(on_frame=stop))
    kept = Usd.Stage.Open(str(tmp_path / "out.usda"))
    points = UsdGeom.BasisCurves.Get(kept, "/World/C").GetPointsAttr()
    assert points.GetTimeSamples() == list(range(7))
