"""What cannot be simulated: one sentence that names it, exit code 2, nothing written."""

import sys

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, Vt
from stages import add_curves, line, new_stage, transform

from pbd_warp.cli import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def refused(monkeypatch, capfd, folder, *args):
    """The one sentence with which a command is refused."""
    there = {path.name: path.read_bytes() for path in folder.iterdir()}
    monkeypatch.setattr(sys, "argv", ["pbd-warp", "simulate", *args])
    with pytest.raises(SystemExit) as stop:
        main()
    text = capfd.readouterr().err.strip()
    assert stop.value.code == 2, text
    lines = [line for line in text.splitlines() if not line.startswith("Warp ")]
    assert len(lines) == 1, text
    assert lines[0].startswith("pbd-warp: ")
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == there, "nothing written"
    return lines[0]


def no_metres(stage, curves):
    UsdGeom.SetStageMetersPerUnit(stage, 0.0)


def time_that_stands(stage, curves):
    stage.SetTimeCodesPerSecond(0.0)


def time_that_goes_back(stage, curves):
    stage.SetEndTimeCode(-1.0)


def time_without_end(stage, curves):
    stage.SetEndTimeCode(1e12)


def sideways(stage, curves):
    stage.SetMetadata("upAxis", "X")


def no_curves(stage, curves):
    stage.RemovePrim(curves.GetPath())


def empty_curves(stage, curves):
    curves.GetPrim().RemoveProperty("curveVertexCounts")


def nan_points(stage, curves):
    points = np.array(curves.GetPointsAttr().Get())
    points[3, 1] = np.nan
    curves.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(points))


def nan_points_later(stage, curves):
    curves.GetPointsAttr().Set(curves.GetPointsAttr().Get(), 0)
    nan_points(stage, curves)
    curves.GetPointsAttr().Set(curves.GetPointsAttr().Get(Usd.TimeCode.Default()), 10)


def counts_that_do_not_add_up(stage, curves):
    curves.GetCurveVertexCountsAttr().Set([4, 3])


def counts_that_change(stage, curves):
    curves.GetCurveVertexCountsAttr().Set([6], 0)
    curves.GetCurveVertexCountsAttr().Set([3, 3], 1)


def points_that_get_fewer(stage, curves):
    points = curves.GetPointsAttr().Get()
    curves.GetPointsAttr().Set(points, 0)
    curves.GetPointsAttr().Set(points[:5], 12)


def too_few_for_a_cubic(stage, curves):
    curves.GetTypeAttr().Set("cubic")


def old_basis(stage, curves):
    curves.GetTypeAttr().Set("cubic")
    curves.CreateBasisAttr("power")


def odd_wrap(stage, curves):
    curves.GetWrapAttr().Set("around")


def nan_widths(stage, curves):
    curves.GetWidthsAttr().Set([float("nan")])


def flat_parent(stage, curves):
    transform(stage.GetPrimAtPath("/World"), scale=(1, 0, 1))


def flat_for_a_moment(stage, curves):
    scale = UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddScaleOp()
    for time_code in (0, 20):
        scale.Set(Gf.Vec3f(1, 1 - time_code / 10, 1), time_code)


def bad_attribute(stage, curves):
    curves.GetPrim().CreateAttribute("pbd:density", Sdf.ValueTypeNames.Float).Set(-3.0)


def bad_pin_attribute(stage, curves):
    curves.GetPrim().CreateAttribute("pbd:pin", Sdf.ValueTypeNames.Token).Set("top")


def short_primvar(stage, curves):
    UsdGeom.PrimvarsAPI(curves).CreatePrimvar("hold", Sdf.ValueTypeNames.IntArray, "vertex").Set([1, 0])


def colours(stage, curves):
    UsdGeom.PrimvarsAPI(curves).CreatePrimvar("hold", Sdf.ValueTypeNames.Color3fArray, "constant").Set([(1, 0, 0)])


def text(stage, curves):
    UsdGeom.PrimvarsAPI(curves).CreatePrimvar("hold", Sdf.ValueTypeNames.StringArray, "constant").Set(["yes"])


def per_face(stage, curves):
    UsdGeom.PrimvarsAPI(curves).CreatePrimvar("hold", Sdf.ValueTypeNames.IntArray, "faceVarying").Set([1])


def periodic(stage, curves):
    curves.GetWrapAttr().Set("periodic")
    points = curves.GetPointsAttr()
    points.Set(Vt.Vec3fArray.FromNumpy((np.array(points.Get()) + 0.3 * np.eye(6, 3)).astype(np.float32)))


def a_mesh(points=((0, 0, 0), (1, 0, 0), (0, 1, 0)), counts=(3,), corners=(0, 1, 2)):
    def spoil(stage, curves):
        mesh = UsdGeom.Mesh.Define(stage, "/World/Set/Wall")
        mesh.CreatePointsAttr(list(points))
        mesh.CreateFaceVertexCountsAttr(list(counts))
        mesh.CreateFaceVertexIndicesAttr(list(corners))

    return spoil


def a_mesh_that_bends(stage, curves):
    a_mesh()(stage, curves)
    points = UsdGeom.Mesh.Get(stage, "/World/Set/Wall").GetPointsAttr()
    points.Set([(0, 0, 0), (1, 0, 0), (0, 1, 0)], 0)
    points.Set([(0, 0, 0), (1, 0, 0), (0, 2, 0)], 10)


def a_disc(stage, curves):
    stage.DefinePrim("/World/Set/Disc", "NurbsPatch")


def a_cone_on_a_odd_axis(stage, curves):
    UsdGeom.Cone.Define(stage, "/World/Set/Cone").CreateAxisAttr("Q")


def a_flat_cylinder(stage, curves):
    UsdGeom.Cylinder.Define(stage, "/World/Set/Drum").CreateHeightAttr(0.0)


def swelling_sphere(stage, curves):
    scale = UsdGeom.Sphere.Define(stage, "/World/Set/Ball").AddScaleOp()
    scale.Set(Gf.Vec3f(1, 1, 1), 0)
    scale.Set(Gf.Vec3f(2, 2, 2), 10)


def growing_sphere(stage, curves):
    radius = UsdGeom.Sphere.Define(stage, "/World/Set/Ball").CreateRadiusAttr()
    radius.Set(1.0, 0)
    radius.Set(2.0, 10)


def odd_plane(stage, curves):
    UsdGeom.Plane.Define(stage, "/World/Set/Floor").CreateAxisAttr("Q")


def rough_plane(stage, curves):
    plane = UsdGeom.Plane.Define(stage, "/World/Set/Floor")
    plane.GetPrim().CreateAttribute("pbd:friction", Sdf.ValueTypeNames.Float).Set(-1.0)


@pytest.mark.parametrize(
    ("spoil", "args", "message"),
    [
        (no_metres, [], "metersPerUnit of a.usda must be a finite number above 0, not 0"),
        (time_that_stands, [], "timeCodesPerSecond must be a finite number above 0"),
        (time_that_goes_back, [], "endTimeCode must be a finite number of at least 0, not -1"),
        (time_without_end, [], "frames are more than 1000000: give the number of them with --frames"),
        (None, ["--frames", "1000000000000"], "1000000000000 frames are more than 1000000"),
        (sideways, [], "a.usda: upAxis must be Y or Z, not 'X'"),
        (odd_plane, ["--collide", "/World/Set"], "/World/Set/Floor: its axis must be X, Y or Z, not 'Q'"),
        (no_curves, [], "the stage has no curves (BasisCurves, NurbsCurves, HermiteCurves)"),
        (empty_curves, [], "/World/C: it has no curves"),
        (
            nan_points,
            [],
            "curve 0 cannot be simulated: points at time code 0 must be finite, but number 3 is (0.6, nan, 0)",
        ),
        (nan_points_later, [], "points at time code 1 must be finite, but number 3"),
        (counts_that_do_not_add_up, [], "/World/C: curveVertexCounts add up to 7, but there are 6 points"),
        (counts_that_change, [], "/World/C: curveVertexCounts changes with time"),
        (points_that_get_fewer, [], "add up to 6, but there are 5 points at time code 12"),
        (
            too_few_for_a_cubic,
            [],
            "/World/C: curve 0 cannot be simulated: it has 6 control points; a nonperiodic bezier curve needs 4, or 3",
        ),
        (old_basis, [], "/World/C: unknown basis 'power': there is bezier, bspline, catmullRom"),
        (odd_wrap, [], "/World/C: unknown wrap 'around': there is nonperiodic, periodic, pinned"),
        (nan_widths, [], "/World/C: curve 0 cannot be simulated: one of its widths is not finite"),
        (flat_parent, [], "/World/C: its transform cannot be inverted at time code 0"),
        (flat_for_a_moment, [], "/World/C: its transform cannot be inverted at time code 10"),
        (bad_attribute, [], "/World/C: pbd:density must be a finite number above 0, not -3"),
        (bad_pin_attribute, [], "/World/C: pbd:pin must be root, ends, none or primvar:NAME, not 'top'"),
        (None, ["--pin", "primvar:hold"], "/World/C: it has no primvar 'hold' to pin by"),
        (short_primvar, ["--pin", "primvar:hold"], "primvar 'hold' must be 6 for interpolation 'vertex', but there"),
        (colours, ["--pin", "primvar:hold"], "/World/C: primvar 'hold' is not made of numbers"),
        (text, ["--pin", "primvar:hold"], "/World/C: primvar 'hold' is not made of numbers"),
        (per_face, ["--pin", "primvar:hold"], "primvar 'hold' has interpolation 'faceVarying'"),
        (periodic, ["--pin", "ends"], "/World/C: a periodic curve has no ends to pin"),
        (None, ["--prim", "/World/Rope*"], "--prim /World/Rope* matches no curves: there is /World/C"),
        (None, ["--collide", "/World/Floor"], "--collide /World/Floor matches no geometry"),
        (None, ["--collide", "/World/C"], "/World/C: it is a BasisCurves, which is not supported as a collider"),
        (None, ["--collide", "physics"], "--collide physics matches no geometry"),
        (a_disc, ["--collide", "/World/Set"], "/World/Set/Disc: it is a NurbsPatch, which is not supported"),
        (a_mesh(counts=(), corners=()), ["--collide", "/World/Set"], "/World/Set/Wall: the mesh has no triangles"),
        (a_mesh(corners=(0, 1, 3)), ["--collide", "/World/Set"], "Wall: a triangle of the mesh names point 3, but"),
        (a_mesh(corners=(0, 1, -1)), ["--collide", "/World/Set"], "Wall: a triangle of the mesh names point -1, but"),
        (a_mesh(counts=(4,)), ["--collide", "/World/Set"], "faceVertexCounts add up to 4, but there are 3"),
        (a_mesh(corners=(0, 1, 1)), ["--collide", "/World/Set"], "Wall: no triangle of the mesh has an area"),
        (a_mesh([(0, 0, np.nan)] * 3), ["--collide", "/World/Set"], "/World/Set/Wall: points must be finite"),
        (a_mesh_that_bends, ["--collide", "/World/Set"], "/World/Set/Wall: its points change with time"),
        (growing_sphere, ["--collide", "/World/Set"], "/World/Set/Ball: its radius change with time"),
        (swelling_sphere, ["--collide", "/World/Set"], "/World/Set/Ball: its scale changes until time code"),
        (a_cone_on_a_odd_axis, ["--collide", "/World/Set"], "/World/Set/Cone: its axis must be X, Y or Z, not 'Q'"),
        (a_flat_cylinder, ["--collide", "/World/Set"], "/World/Set/Drum: height must be a finite number above 0"),
        (rough_plane, ["--collide", "/World/Set"], "/World/Set/Floor: friction must be"),
        (None, ["--pin", "top"], "pin must be root, ends, none or primvar:NAME, not 'top'"),
        (None, ["--density", "0"], "density must be a finite number above 0"),
        (None, ["--density", "5", "--mass", "5"], "density and mass both say how heavy a curve is"),
        (None, ["--compliance", "-1"], "compliance must be"),
        (None, ["--damping", "2"], "damping must be"),
        (None, ["--gravity", "nan"], "gravity must be"),
        (None, ["--frames", "0"], "frames must be at least 1"),
        (None, ["--fps", "0"], "fps must be"),
        (None, ["--substeps", "0"], "substeps must be at least 1"),
        (None, ["--dtype", "float16"], "unknown dtype"),
        (None, ["--device", "cpx"], "unknown device"),
        (None, ["--method", "jacoby"], "unknown method"),
        (None, ["--integrator", "bdf2", "--damping", "0.1"], "integrator 'bdf2' does not model damping"),
        (None, ["--stats", "no/s.json"], "no does not exist"),
    ],
)
def test_refused(folder, monkeypatch, capfd, spoil, args, message):
    stage = new_stage(folder / "a.usda")
    curves = add_curves(stage, "/World/C", line())
    if spoil:
        spoil(stage, curves)
    stage.Save()
    assert message in refused(monkeypatch, capfd, folder, "a.usda", "--out", "b.usda", *args)


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("a.usda", "--out and the stage are both"),
        ("./a.usda", "--out and the stage are both"),
        ("set.usda", "--out and the stage are both"),
        ("b.abc", "must end in one of"),
        ("b.usdz", "must end in one of"),
        ("no/b.usda", "no does not exist"),
    ],
)
def test_outputs_refused(folder, monkeypatch, capfd, out, message):
    below = new_stage(folder / "set.usda")
    add_curves(below, "/World/C", line())
    below.Save()
    stage = new_stage(folder / "a.usda")
    stage.GetRootLayer().subLayerPaths.append("./set.usda")
    stage.Save()
    assert message in refused(monkeypatch, capfd, folder, "a.usda", "--out", out)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.usda", None, "there is no file a.usda"),
        ("a.usda", "hello", "a.usda cannot be read as USD"),
        ("a.usdc", "hello", "a.usdc cannot be read as USD"),
        ("a.usdz", "hello", "a.usdz cannot be read as USD"),
        ("a.usda", '#usda 1.0\ndef Xform "broken" {', "a.usda cannot be read as USD"),
        ("a.obj", "v 0 0 0", "a.obj must end in one of .usda, .usdc, .usd, .usdz"),
        ("a.usda", "#usda 1.0\n(subLayers = [@./gone.usda@])\n", "a.usda is not complete: Could not load sublayer"),
        ("a.usda", '#usda 1.0\ndef "A" (references = @gone.usda@) {}\n', "a.usda is not complete: In </A>: Could not"),
    ],
)
def test_files_refused(folder, monkeypatch, capfd, name, content, message):
    if content is not None:
        (folder / name).write_text(content)
    assert message in refused(monkeypatch, capfd, folder, name, "--out", "b.usda")
