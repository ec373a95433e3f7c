"""Composition: whatever brings curves into a stage, what was asked for moves, and nothing else does."""

import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom
from stages import add_curves, line, new_stage, simulated, transform, world

import pbd_warp as pbd
from pbd_warp.cli import main
from pbd_warp.curves import StageHooks, load_stage, simulate

DATA = Path(__file__).parent / "data" / "curves"


def asset(path, up="Y"):
    stage = new_stage(path, up)
    add_curves(stage, "/World/C", line())
    stage.Save()


def sublayer_with_offset(stage, folder):
    below = new_stage(folder / "below.usda")
    curves = add_curves(below, "/World/Placed/C", line())
    for time_code in (0, 10):
        shifted = np.asarray(line(), np.float32) + np.float32([0, 0.01 * time_code, 0])
        curves.GetPointsAttr().Set(shifted, time_code)
    below.Save()
    layer = stage.GetRootLayer()
    layer.subLayerPaths.append("./below.usda")
    layer.subLayerOffsets[0] = Sdf.LayerOffset(4.0, 0.5)


def payload(stage, folder):
    asset(folder / "asset.usda")
    stage.DefinePrim("/World/Placed").GetPayloads().AddPayload("./asset.usda")


def reference_with_offset(stage, folder):
    asset(folder / "asset.usda")
    stage.DefinePrim("/World/Placed").GetReferences().AddReference("./asset.usda", "/World", Sdf.LayerOffset(5.0, 2.0))


def sub_root_reference(stage, folder):
    asset(folder / "asset.usda")
    stage.DefinePrim("/World/Placed/C").GetReferences().AddReference("./asset.usda", "/World/C")


def variant(stage, folder):
    asset(folder / "asset.usda")
    prim = stage.DefinePrim("/World/Placed")
    variants = prim.GetVariantSets().AddVariantSet("look")
    for name in ("bare", "dressed"):
        variants.AddVariant(name)
    variants.SetVariantSelection("dressed")
    with variants.GetVariantEditContext():
        prim.GetReferences().AddReference("./asset.usda")


def inherit(stage, folder):
    stage.CreateClassPrim("/_class_Rope")
    add_curves(stage, "/_class_Rope/C", line())
    stage.DefinePrim("/World/Placed").GetInherits().AddInherit("/_class_Rope")


def specialize(stage, folder):
    stage.CreateClassPrim("/_Rope")
    add_curves(stage, "/_Rope/C", line())
    stage.DefinePrim("/World/Placed").GetSpecializes().AddSpecialize("/_Rope")


def relocate(stage, folder):
    asset(folder / "asset.usda")
    stage.DefinePrim("/World/Before").GetReferences().AddReference("./asset.usda")
    stage.DefinePrim("/World/Placed")
    stage.GetRootLayer().relocates = [(Sdf.Path("/World/Before/C"), Sdf.Path("/World/Placed/C"))]


def expression(stage, folder):
    """USD reads variables of the root layer only."""
    asset(folder / "asset.usda")
    stage.GetRootLayer().expressionVariables = {"WHICH": "asset"}
    stage.DefinePrim("/World/Placed").GetReferences().AddReference('`"./${WHICH}.usda"`')


def value_clips(stage, folder):
    curves = add_curves(stage, "/World/Placed/C", line())
    clip = Usd.Stage.CreateNew(str(folder / "clip.usda"))
    points = UsdGeom.BasisCurves.Define(clip, "/World/Placed/C").CreatePointsAttr()
    for time_code in range(24):
        points.Set(np.asarray(line(), np.float32) + np.float32([0, 0.01 * time_code, 0]), time_code)
    clip.Save()
    curves.GetPointsAttr().Clear()
    api = Usd.ClipsAPI(stage.GetPrimAtPath("/World/Placed"))
    api.SetClipAssetPaths(["./clip.usda"])
    api.SetClipPrimPath("/World/Placed")
    api.SetClipActive([(0, 0)])
    api.SetClipManifestAssetPath("./clip.usda")


FOLLOWED = [
    *(sublayer_with_offset, payload, reference_with_offset, sub_root_reference, variant, inherit, specialize),
    *(relocate, expression, value_clips),
]


@pytest.mark.parametrize("flatten", [False, True])
@pytest.mark.parametrize("arc", FOLLOWED, ids=lambda arc: arc.__name__)
def test_followed(tmp_path, arc, flatten):
    stage = new_stage(tmp_path / "a.usda")
    arc(stage, tmp_path)
    placed = stage.GetPrimAtPath("/World/Placed")
    if placed.GetTypeName() == "":
        placed.SetTypeName("Xform")
    transform(placed, (5, 0, 0), (0, 90, 0))
    stage.Save()
    before = Usd.Stage.Open(str(tmp_path / "a.usda"))
    result, _, stats = simulated(tmp_path / "a.usda", flatten=flatten)
    np.testing.assert_allclose(world(result, "/World/Placed/C", 0), world(before, "/World/Placed/C", 0), atol=1e-6)
    for time_code in range(24):
        root = world(before, "/World/Placed/C", time_code)[0]
        np.testing.assert_allclose(world(result, "/World/Placed/C", time_code)[0], root, atol=1e-6)
    hangs = world(result, "/World/Placed/C", 12)
    assert hangs[0, 1] - hangs[-1, 1] > 0.2
    assert stats.max_stretch < 1e-4


def everything(stage, skip):
    """All points of a stage but of one prim, at three times."""
    return {
        (str(prim.GetPath()), time_code): np.array(UsdGeom.PointBased(prim).GetPointsAttr().Get(time_code))
        for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies())
        for time_code in (0, 5, 23)
        if prim.IsA(UsdGeom.PointBased) and str(prim.GetPath()) != skip
    }


@pytest.mark.parametrize("kind", ["References", "Inherits", "Specializes", "Payloads"])
@pytest.mark.parametrize("instanceable", [False, True])
def test_what_others_take_over_is_refused_alone_and_no_other_is_changed(tmp_path, kind, instanceable):
    stage = new_stage(tmp_path / "a.usda")
    UsdGeom.Xform.Define(stage, "/World/A")
    add_curves(stage, "/World/A/C", line())
    add_curves(stage, "/World/Other", line() + 3)
    twin = stage.DefinePrim("/World/B", "Xform")
    arcs = getattr(twin, f"Get{kind}")()
    add = getattr(
        arcs, {"References": "AddInternalReference", "Payloads": "AddInternalPayload"}.get(kind, f"Add{kind[:-1]}")
    )
    add("/World/A")
    twin.SetInstanceable(instanceable)
    transform(twin, rotate=(0, 0, 180))
    stage.Save()
    with pytest.raises(pbd.InputError, match=r"^/World/A/C: /World/B/C takes it over .* and would change with it"):
        load_stage(tmp_path / "a.usda", prims=["/World/A"])
    result, source, _ = simulated(tmp_path / "a.usda")
    if instanceable:
        assert [curves.path for curves in source.curves] == ["/World/Other"]
        assert [text.split(" is left as it is: ")[0] for text in source.left] == ["/World/B/C", "/World/A/C"]
        before = everything(Usd.Stage.Open(str(tmp_path / "a.usda")), "/World/Other")
        after = everything(result, "/World/Other")
        assert before.keys() == after.keys()
        assert all(np.array_equal(before[key], after[key]) for key in before)
    else:
        assert not source.left
        for path in ("/World/A/C", "/World/B/C"):  # both hang down, each by its own
            assert world(result, path, 23)[-1, 1] < -0.1


def test_taken_over_from_a_class_by_two_each_moves_by_itself(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    stage.CreateClassPrim("/_Hair")
    add_curves(stage, "/_Hair/C", line())
    for number in range(2):
        prim = stage.DefinePrim(f"/World/H{number}", "Xform")
        prim.GetInherits().AddInherit("/_Hair")
        transform(prim, (number, 0, 0), (0, 90 * number, 0))
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", prims=["/World/H1"])
    assert len(source.curves) == 1
    np.testing.assert_array_equal(world(result, "/World/H0/C", 23), world(stage, "/World/H0/C", 23))
    assert world(result, "/World/H1/C", 23)[-1, 1] < -0.1


def test_a_copy_of_what_cannot_be_simulated_for_other_reasons_keeps_its_points(tmp_path):
    """B takes over A's points but has counts of its own that do not fit: A must not change B."""
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/A", line())
    add_curves(stage, "/World/Other", line() + 3)
    twin = stage.DefinePrim("/World/B")
    twin.GetReferences().AddInternalReference("/World/A")
    UsdGeom.BasisCurves(twin).GetCurveVertexCountsAttr().Set([7])
    stage.Save()
    source = load_stage(tmp_path / "a.usda")
    assert [curves.path for curves in source.curves] == ["/World/Other"]


def test_the_file_in_which_an_instance_refers_to_another_prim(tmp_path, monkeypatch, capsys):
    arguments = ["simulate", str(DATA / "referenced_inside.usda"), "--prim", "/A", "--out", str(tmp_path / "o.usda")]
    monkeypatch.setattr(sys, "argv", ["pbd-warp", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "/A/cable: /B/cable takes it over" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_all_that_the_root_layer_alone_can_say_is_said_again(tmp_path):
    stage = new_stage(tmp_path / "a.usda", up="Z", metres=0.1)
    add_curves(stage, "/World/C", line())
    stage.SetMetadata("kilogramsPerUnit", 0.001)
    (tmp_path / "colours.ocio").write_text("")
    stage.SetColorConfiguration(Sdf.AssetPath("./colours.ocio"))
    stage.GetRootLayer().customLayerData = {"cameraSettings": {"boundCamera": "/World/Cam"}}
    stage.Save()
    (tmp_path / "shot").mkdir()
    result, _, _ = simulated(tmp_path / "a.usda", tmp_path / "shot" / "o.usda")
    assert result.GetMetadata("kilogramsPerUnit") == 0.001
    assert result.GetColorConfiguration().path == "../colours.ocio"
    assert result.GetRootLayer().customLayerData["cameraSettings"] == {"boundCamera": "/World/Cam"}
    assert result.GetRootLayer().customLayerData["method"] == "direct"


def copy_of_an_unfinished_file(folder):
    """What a run that is killed after 50 frames leaves."""
    stage = new_stage(folder / "a.usda", last=60)
    add_curves(stage, "/World/C", line())
    stage.Save()

    def keep(done):
        if done == 50:
            shutil.copytree(folder, folder / "kept")

    simulate(load_stage(folder / "a.usda"), folder / "o.usda", hooks=StageHooks(on_frame=keep))
    return folder / "kept" / "o.partial.usda"


@pytest.mark.parametrize(
    ("prim", "shown"), [(None, "/World/X/C"), ("/World", "/World/X/C"), ("/World/C", None)], ids=str
)
def test_an_unfinished_file_shows_by_a_reference_to_its_root_prim(tmp_path, prim, shown):
    """As stages.md says: value clips lie on root prims, and a reference below them does not see those."""
    unfinished = copy_of_an_unfinished_file(tmp_path)
    stage = new_stage(tmp_path / "shot.usda")
    placed = stage.DefinePrim("/World/X")
    if prim is None:
        placed.GetReferences().AddReference(str(unfinished))
    else:
        placed.GetReferences().AddReference(str(unfinished), prim)
    moving = UsdGeom.BasisCurves.Get(stage, shown or "/World/X").GetPointsAttr()
    if shown:
        assert moving.Get(20)[-1][1] < -0.1
    else:
        np.testing.assert_array_equal(moving.Get(20), line().astype(np.float32))


def test_every_row_of_the_table_in_the_docs_has_its_tests():
    text = (Path(__file__).parents[1] / "docs" / "stages.md").read_text()
    rows = text.split("## Composition and schemas")[1].split("|---|---|---|\n")[1].split("\n\n")[0].splitlines()
    assert len(rows) > 20
    code = "".join(path.read_text() for path in Path(__file__).parent.glob("test_stage*.py"))
    for row in rows:
        _, what, outcome, tests, _ = row.split("|")
        assert outcome.strip(), what
        names = re.findall(r"`(\w+)`", tests)
        assert names, what
        for name in names:
            assert f"def {name}(" in code, f"{what}: {name}"
