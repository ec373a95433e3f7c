"""Small stages that several tests make, and what they look at in the ones that come back."""

from pathlib import Path

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdValidation, Vt

from pbd_warp.curves import Material, load_stage, simulate

CABLES = Path(__file__).parent / "data" / "cables_blender.usda"
MATERIAL = ("pin", "density", "mass", "compliance")


def new_stage(path, up="Y", metres=1.0, first=0, last=23, fps=24.0):
    """An empty stage with a default prim /World."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetStartTimeCode(first)
    stage.SetEndTimeCode(last)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


def add_curves(stage, path, points, counts=None, basis="linear", wrap="nonperiodic", width=0.02):
    """BasisCurves with a valid extent; `basis` "linear" or that of a cubic."""
    curves = UsdGeom.BasisCurves.Define(stage, path)
    curves.CreateTypeAttr("linear" if basis == "linear" else "cubic")
    if basis != "linear":
        curves.CreateBasisAttr(basis)
    curves.CreateWrapAttr(wrap)
    points = np.asarray(points, np.float32)
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    curves.CreateCurveVertexCountsAttr(Vt.IntArray(counts or [len(points)]))
    if width is not None:
        curves.CreateWidthsAttr([width])
        curves.SetWidthsInterpolation("constant")
    curves.CreateExtentAttr(UsdGeom.BasisCurves.ComputeExtent(curves.GetPointsAttr().Get(), [width or 0.0]))
    return curves


def line(n=6, start=(0, 0, 0), end=(1, 0, 0)):
    return np.linspace(start, end, n)


def transform(prim, translate=(0, 0, 0), rotate=(0, 0, 0), scale=(1, 1, 1)):
    xform = UsdGeom.Xformable(prim)
    xform.AddTranslateOp().Set(Gf.Vec3d(*map(float, translate)))
    xform.AddRotateXYZOp().Set(Gf.Vec3f(*map(float, rotate)))
    xform.AddScaleOp().Set(Gf.Vec3f(*map(float, scale)))


def simulated(path, out=None, flatten=False, settings=(), check=True, **options):
    """Simulate a stage file; gives the stage that came out, what was simulated, and its figures."""
    out = out or path.with_name(f"sim_{path.stem}.usda")
    material = Material(**{name: options.pop(name) for name in MATERIAL if name in options})
    source = load_stage(path, material=material, **options).changed(**dict(settings))
    before = path.read_bytes()
    stats = simulate(source, out, flatten)
    assert path.read_bytes() == before, "the input is never touched"
    stage = Usd.Stage.Open(str(out))
    if check:  # inputs from elsewhere may not be valid
        check_valid(stage, source)
    return stage, source, stats


def check_valid(stage, source):
    """All of USD's validators, and extents as USD computes them itself at every frame."""
    assert not stage.GetCompositionErrors()
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert [f"{e.GetName()}: {e.GetMessage()}" for e in context.Validate(stage)] == []
    for curves in source.curves:
        boundable = UsdGeom.Boundable.Get(stage, curves.path)
        for time_code in source.timeline.time_codes:
            stored = boundable.GetExtentAttr().Get(time_code)
            computed = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, time_code)
            np.testing.assert_array_equal(np.array(stored), np.array(computed))


def local(stage, path, time_code, name="points"):
    return np.array(stage.GetPrimAtPath(path).GetAttribute(name).Get(time_code), np.float64)


def world(stage, path, time_code):
    """Points in world space [m]."""
    matrix = np.array(UsdGeom.Imageable.Get(stage, path).ComputeLocalToWorldTransform(time_code))
    return (local(stage, path, time_code) @ matrix[:3, :3] + matrix[3, :3]) * UsdGeom.GetStageMetersPerUnit(stage)
