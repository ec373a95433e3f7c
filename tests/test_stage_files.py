"""Files: the layer over the input, the flattened file, packages, and a stage that Blender wrote."""

import json
import shutil
import sys

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade, UsdUtils
from stages import CABLES, add_curves, check_valid, line, local, new_stage, simulated, transform, world

from pbd_warp.cli import main
from pbd_warp.curves import load_stage

CURVES = {"/root/PowerLines/PowerLines": 123, "/root/Vines/Vines": 147, "/root/Whip/Whip": 22}


def command(monkeypatch, *args):
    monkeypatch.setattr(sys, "argv", ["pbd-warp", "simulate", *map(str, args)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 0


def attributes(stage):
    """Every attribute of a stage but those that a simulation gives, as values at time code 3."""
    changed = ("points", "velocities", "extent")
    return {
        str(attribute.GetPath()): attribute.Get(3)
        for prim in stage.Traverse()
        for attribute in prim.GetAttributes()
        if attribute.HasAuthoredValue() and not (prim.IsA(UsdGeom.BasisCurves) and attribute.GetName() in changed)
    }


@pytest.mark.parametrize("flatten", [False, True])
def test_the_stage_by_blender(tmp_path, monkeypatch, capsys, flatten):
    set_ = tmp_path / "set" / "cables.usda"
    set_.parent.mkdir()
    shutil.copy(CABLES, set_)
    out = tmp_path / "anim" / "sim.usda"
    out.parent.mkdir()
    args = ["--frames", 25, "--stats", tmp_path / "s.json", *(["--flatten"] if flatten else [])]
    command(monkeypatch, set_, "--out", out, *args)
    assert set_.read_bytes() == CABLES.read_bytes()
    stats = json.loads((tmp_path / "s.json").read_text())
    assert (stats["frames"], stats["particles"], stats["method"], stats["unconverged"]) == (25, 292, "direct", 0)
    assert stats["max_stretch"] < 1e-4
    assert "cables, 292 particles, 282 constraints" in capsys.readouterr().out

    layer = Sdf.Layer.FindOrOpen(str(out))
    assert list(layer.subLayerPaths) == ([] if flatten else ["../set/cables.usda"])
    assert (layer.defaultPrim, layer.startTimeCode, layer.endTimeCode) == ("root", 0, 24)
    assert (layer.timeCodesPerSecond, layer.framesPerSecond) == (24, 24)
    assert layer.customLayerData["method"] == "direct"
    assert str(tmp_path) not in layer.ExportToString()
    if flatten:
        set_.unlink()
    stage, source = Usd.Stage.Open(str(out)), load_stage(CABLES, frames=25)
    check_valid(stage, source)
    before = Usd.Stage.Open(str(CABLES))
    assert attributes(stage) == attributes(before), "set dressing, topology, widths and primvars stay"
    for path, count in CURVES.items():
        assert local(stage, path, 24).shape == (count, 3)
        np.testing.assert_array_equal(local(stage, path, 0), local(before, path, 0))
        curves = UsdGeom.BasisCurves.Get(stage, path)
        for attribute in (curves.GetPointsAttr(), curves.GetVelocitiesAttr(), curves.GetExtentAttr()):
            assert attribute.GetTimeSamples() == list(range(25))
        counts = np.array(curves.GetCurveVertexCountsAttr().Get())
        roots = np.cumsum(counts) - counts
        np.testing.assert_allclose(local(stage, path, 24)[roots], local(before, path, 0)[roots], atol=1e-12)
        fell = world(stage, path, 0)[..., 2].mean() - world(stage, path, 24)[..., 2].mean()
        assert fell > 0.005, "z is up"


def test_a_simulation_that_fails_says_so_and_keeps_its_frames(tmp_path, monkeypatch, capsys):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line())
    stage.Save()
    monkeypatch.setattr(sys, "argv", ["pbd-warp", "simulate", str(tmp_path / "a.usda"), "--pin", "none"])
    sys.argv += ["--gravity", "3e38", "--frames", "96", "--out", str(tmp_path / "b.usda")]
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 1
    kept = Usd.Stage.Open(str(tmp_path / "b.usda"))
    frames = len(UsdGeom.BasisCurves.Get(kept, "/World/C").GetPointsAttr().GetTimeSamples())
    assert frames > 3
    message = capsys.readouterr().err
    assert f"frame {frames} " in message
    assert f"; the {frames} frames so far are in" in message


def test_the_layer_holds_overrides_only(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line())
    stage.Save()
    simulated(tmp_path / "a.usda", tmp_path / "b.usda")
    layer = Sdf.Layer.FindOrOpen(str(tmp_path / "b.usda"))
    found = []
    layer.Traverse("/", lambda path: found.append(str(path)))
    names = ("points", "velocities", "extent")
    assert set(found) == {"/", "/World", "/World/C", *(f"/World/C.{name}" for name in names)}
    for path in ("/World", "/World/C"):
        assert layer.GetPrimAtPath(path).specifier == Sdf.SpecifierOver
    for name in names:
        assert not layer.GetAttributeAtPath(f"/World/C.{name}").HasDefaultValue()
    assert list(layer.subLayerPaths) == ["./a.usda"]


def test_a_flattened_file_has_no_sample_of_the_old_animation_and_its_own_metadata(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line())
    for time_code in (-5.0, 0.0, 0.25, 30.0):
        curves.GetPointsAttr().Set(curves.GetPointsAttr().Get(), time_code)
    stage.GetRootLayer().customLayerData = {"shot": "a1", "version": "theirs"}
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda", flatten=True)
    assert UsdGeom.BasisCurves.Get(result, "/World/C").GetPointsAttr().GetTimeSamples() == list(range(24))
    data = result.GetRootLayer().customLayerData
    assert data["shot"] == "a1"
    assert data["method"] == "direct"


@pytest.mark.parametrize("suffix", [".usdc", ".usd", ".usdz"])
def test_every_format_is_read(tmp_path, suffix):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line())
    stage.Save()
    path = tmp_path / f"b{suffix}"
    if suffix == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "a.usda"), str(path))
    else:
        stage.GetRootLayer().Export(str(path))
    expected, _, _ = simulated(tmp_path / "a.usda")
    for flatten in (False, True):
        result, _, _ = simulated(path, tmp_path / f"out{flatten}.usdc", flatten=flatten)
        np.testing.assert_array_equal(local(result, "/World/C", 23), local(expected, "/World/C", 23))


def test_materials_relations_and_other_prims_compose(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line())
    material = UsdShade.Material.Define(stage, "/World/Rubber")
    UsdShade.MaterialBindingAPI.Apply(curves.GetPrim()).Bind(material)
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda")
    bound, _ = UsdShade.MaterialBindingAPI(result.GetPrimAtPath("/World/C")).ComputeBoundMaterial()
    assert str(bound.GetPath()) == "/World/Rubber"


def test_what_would_be_wrong_once_the_curves_move_is_blocked(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line())
    curves.CreateAccelerationsAttr([(1, 1, 1)] * 6)
    model = UsdGeom.ModelAPI.Apply(stage.GetPrimAtPath("/World"))
    model.SetExtentsHint(model.ComputeExtentsHint(UsdGeom.BBoxCache(0, ["default"])))
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda")
    assert not UsdGeom.BasisCurves.Get(result, "/World/C").GetAccelerationsAttr().HasValue()
    box = UsdGeom.BBoxCache(23, ["default"], useExtentsHint=True).ComputeWorldBound(result.GetPrimAtPath("/World"))
    assert box.ComputeAlignedRange().GetMin()[1] < -0.1, "the rope hangs down, and its box with it"


def test_some_prims_now_and_others_over_that(tmp_path):
    """Power lines by both ends first, then the vines by their roots, each in a layer of its own."""
    first, source, _ = simulated(CABLES, tmp_path / "lines.usdc", prims=["/root/Power*"], pin="ends", frames=10)
    assert [curves.path for curves in source.curves] == ["/root/PowerLines/PowerLines"]
    second, source, _ = simulated(tmp_path / "lines.usdc", tmp_path / "vines.usdc", prims=["*/Vines"])
    assert [curves.path for curves in source.curves] == ["/root/Vines/Vines"]
    path = "/root/PowerLines/PowerLines"
    for time_code in range(10):
        np.testing.assert_array_equal(local(second, path, time_code), local(first, path, time_code))
    assert UsdGeom.BasisCurves.Get(second, "/root/Vines/Vines").GetPointsAttr().GetNumTimeSamples() == 10


def test_curves_that_a_reference_in_a_variant_brings_are_overridden(tmp_path):
    asset = new_stage(tmp_path / "asset.usda")
    add_curves(asset, "/World/C", line())
    asset.Save()
    stage = new_stage(tmp_path / "a.usda")
    prim = stage.DefinePrim("/World/Placed")
    variants = prim.GetVariantSets().AddVariantSet("look")
    variants.AddVariant("bare")
    variants.SetVariantSelection("bare")
    with variants.GetVariantEditContext():
        prim.GetReferences().AddReference("./asset.usda")
    transform(prim, (5, 0, 0))
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda")
    assert world(result, "/World/Placed/C", 23)[-1, 1] < -0.1
    np.testing.assert_array_equal(world(result, "/World/Placed/C", 23)[0], (5, 0, 0))
