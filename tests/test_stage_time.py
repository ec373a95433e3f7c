"""Attributes sampled in time: read as they are at the first frame; what only might vary is constant."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, Vt
from stages import add_curves, line, local, new_stage, simulated, transform

import pbd_warp as pbd
from pbd_warp.curves import load_stage

DATA = Path(__file__).parent / "data" / "curves"


def copied(tmp_path, name, change=lambda text: text):
    """A small input as a file of its own."""
    path = tmp_path / f"{name}.usda"
    path.write_text(change((DATA / f"{name}.usda").read_text()))
    return path


def whole_scene(stage):
    """A curve and a collider with every attribute that is read."""
    world = UsdGeom.Xform.Get(stage, "/World")
    transform(world, (0.1, 2, 0.3), (10, 20, 30), (1.5, 1.5, 1.5))
    curves = add_curves(stage, "/World/C", line(9, (-0.4, 0.6, 0), (0.4, 0.6, 0)))
    hold = UsdGeom.PrimvarsAPI(curves).CreatePrimvar("hold", Sdf.ValueTypeNames.IntArray, "vertex")
    hold.Set([1, 0, 0, 0, 0, 0, 0, 0, 1])
    ball = UsdGeom.Sphere.Define(stage, "/World/Ball")
    ball.CreateRadiusAttr(0.4)
    ball.CreateExtentAttr([(-0.4, -0.4, -0.4), (0.4, 0.4, 0.4)])
    ball.AddTranslateOp().Set(Gf.Vec3d(0.1, 0, 0))
    own = {"pin": "primvar:hold", "density": 500.0, "compliance": 1e-5}
    for prim, values in (curves.GetPrim(), own), (ball.GetPrim(), {"friction": 0.8, "restitution": 0.1}):
        for name, value in values.items():
            kind = Sdf.ValueTypeNames.Token if isinstance(value, str) else Sdf.ValueTypeNames.Float
            prim.CreateAttribute(f"pbd:{name}", kind).Set(value)


@pytest.mark.parametrize("times", [[0.0], [3.0], [0.0, 7.5, 23.0]], ids=str)
def test_samples_without_a_default_are_what_defaults_are(tmp_path, times):
    for name in ("plain", "sampled"):
        stage = new_stage(tmp_path / f"{name}.usda")
        whole_scene(stage)
        if name == "sampled":
            for prim in stage.Traverse():
                for attribute in prim.GetAttributes():
                    if attribute.HasAuthoredValue() and attribute.GetVariability() == Sdf.VariabilityVarying:
                        value = attribute.Get()
                        attribute.Clear()
                        for time_code in times:
                            attribute.Set(value, time_code)
        stage.Save()
    plain, source, _ = simulated(tmp_path / "plain.usda", collide=["/World/Ball"])
    sampled, other, _ = simulated(tmp_path / "sampled.usda", collide=["/World/Ball"])
    assert not other.left
    for name in ("w", "radius"):
        np.testing.assert_array_equal(*(getattr(s.scene.builder.finalize(), name) for s in (source, other)))
    for time_code in range(24):
        np.testing.assert_array_equal(local(sampled, "/World/C", time_code), local(plain, "/World/C", time_code))


def test_the_file_with_a_radius_that_is_sampled(tmp_path):
    plain = copied(
        tmp_path, "sampled_radius", lambda text: text.replace("radius.timeSamples = {1: 0.4}", "radius = 0.4")
    )
    plain = plain.rename(tmp_path / "plain.usda")
    assert "radius = 0.4" in plain.read_text()
    a, _, _ = simulated(copied(tmp_path, "sampled_radius"), collide=["/ball"], check=False)
    b, _, _ = simulated(plain, collide=["/ball"], check=False)
    for time_code in range(1, 37):
        np.testing.assert_array_equal(local(a, "/cable", time_code), local(b, "/cable", time_code))
    assert np.linalg.norm(local(a, "/cable", 36), axis=1).max() < 2.0


def test_the_file_with_counts_in_every_frame(tmp_path):
    once = copied(
        tmp_path,
        "sampled_counts",
        lambda text: text.replace(".timeSamples = { 1: [3, 3], 2: [3, 3], 3: [3, 3], 4: [3, 3] }", " = [3, 3]"),
    ).rename(tmp_path / "once.usda")
    assert "timeSamples" not in once.read_text()
    a, _, _ = simulated(copied(tmp_path, "sampled_counts"), check=False)
    b, _, _ = simulated(once, check=False)
    for time_code in range(1, 5):
        np.testing.assert_array_equal(local(a, "/fur", time_code), local(b, "/fur", time_code))


def test_the_file_with_a_single_frame(tmp_path):
    result, source, stats = simulated(copied(tmp_path, "single_frame"), check=False)
    (note,) = source.notes
    assert note.startswith("the stage's time codes 1 to 1 are a single frame, so 5 s from there are simulated")
    assert stats.frames == 121
    assert min(local(result, "/cable", t)[-1, 1] for t in range(1, 122)) < 0.75
    _, source, stats = simulated(copied(tmp_path, "single_frame"), frames=7, check=False)
    assert (source.notes, stats.frames) == ([], 7)


@pytest.mark.parametrize("name", ["pbd:density", "pbd:pin", "physics:density", "hold", "basis", "curveVertexCounts"])
def test_what_changes_with_time_is_left_with_the_reason(tmp_path, name):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/Other", line())
    curves = add_curves(stage, "/World/C", line(8), basis="bspline")
    prim = curves.GetPrim()
    values = {
        "pbd:density": (Sdf.ValueTypeNames.Float, 500.0, 600.0),
        "pbd:pin": (Sdf.ValueTypeNames.Token, "root", "ends"),
        "physics:density": (Sdf.ValueTypeNames.Float, 500.0, 600.0),
        "basis": (Sdf.ValueTypeNames.Token, "bspline", "catmullRom"),
        "curveVertexCounts": (Sdf.ValueTypeNames.IntArray, [8], [4, 4]),
    }
    if name == "hold":
        primvar = UsdGeom.PrimvarsAPI(curves).CreatePrimvar("hold", Sdf.ValueTypeNames.IntArray, "vertex")
        for time_code, first in (0, 1), (5, 0):
            primvar.Set([first, 0, 0, 0, 0, 0, 0, 0], time_code)
        prim.CreateAttribute("pbd:pin", Sdf.ValueTypeNames.Token).Set("primvar:hold")
    else:
        kind, first, then = values[name]
        attribute = prim.CreateAttribute(name, kind)
        attribute.Set(first, 0)
        attribute.Set(then, 5)
    stage.Save()
    source = load_stage(tmp_path / "a.usda")
    assert [each.path for each in source.curves] == ["/World/Other"]
    (reason,) = source.left
    assert reason.startswith("/World/C is left as it is: ")
    assert "changes with time" in reason
    with pytest.raises(pbd.InputError, match="changes with time"):
        load_stage(tmp_path / "a.usda", strict=True)


def test_points_that_are_sampled_but_the_same_do_not_move(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line())
    points = Vt.Vec3fArray.FromNumpy(line().astype(np.float32))
    turn = UsdGeom.Xformable(stage.GetPrimAtPath("/World")).AddRotateYOp()
    for time_code in range(24):
        curves.GetPointsAttr().Set(points, time_code)
        turn.Set(30.0, time_code)
    stage.Save()
    (curves,) = load_stage(tmp_path / "a.usda").curves
    assert not curves.moving


def test_widths_that_change_are_those_of_the_first_frame(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line(), width=0.02)
    curves.GetWidthsAttr().Clear()
    for time_code, width in (0, 0.02), (20, 0.5):
        curves.GetWidthsAttr().Set([width], time_code)
    stage.Save()
    _, source, _ = simulated(tmp_path / "a.usda")  # which checks the extents of every frame
    np.testing.assert_allclose(2 * source.scene.builder.finalize().radius, 0.02)
    assert any("widths change with time" in text for text in source.left)


def test_a_range_that_is_only_begun(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    stage.ClearMetadata("endTimeCode")
    stage.SetStartTimeCode(101)
    add_curves(stage, "/World/C", line())
    stage.Save()
    time = load_stage(tmp_path / "a.usda").timeline
    assert (time.start, time.frames) == (101, 121)
