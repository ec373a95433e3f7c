"""Curves that a skeleton or blend shapes deform: simulated from where they are shown, and shown as they are written."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdSkel, Vt
from stages import add_curves, line, local, new_stage, simulated, transform, world

import pbd_warp as pbd
from pbd_warp.curves import load_stage

DATA = Path(__file__).parent / "data" / "curves"


def shown(path, prim, time_code):
    """What a renderer shows, in world space [m]: USD's own bake of all deformation, and then of placement."""
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.GetRootLayer().subLayerPaths.append(str(path))
    for each in stage.Traverse():
        if each.IsA(UsdSkel.Root):
            assert UsdSkel.BakeSkinning(UsdSkel.Root(each), Gf.Interval(0, 23))
    return world(stage, prim, time_code)


def rig(stage, turn=90.0, rigid=False):
    """A hair along x bound to one joint at the origin that turns about z, under a moved SkelRoot."""
    body = UsdSkel.Root.Define(stage, "/World/Body")
    transform(body, (3, 0, 0), (0, 30, 0), (2, 2, 2))
    skeleton = UsdSkel.Skeleton.Define(stage, "/World/Body/Skel")
    skeleton.AddTranslateOp().Set(Gf.Vec3d(0, 0.5, 0))
    identity = Vt.Matrix4dArray([Gf.Matrix4d(1.0)])
    skeleton.CreateJointsAttr(["head"])
    skeleton.CreateBindTransformsAttr(identity)
    skeleton.CreateRestTransformsAttr(identity)
    animation = UsdSkel.Animation.Define(stage, "/World/Body/Anim")
    animation.CreateJointsAttr(["head"])
    animation.CreateTranslationsAttr([(0, 0, 0)])
    animation.CreateScalesAttr([(1, 1, 1)])
    rotations = animation.CreateRotationsAttr()
    for time_code in range(24):
        quaternion = Gf.Rotation(Gf.Vec3d.ZAxis(), turn * time_code / 23).GetQuat()
        rotations.Set(Vt.QuatfArray([Gf.Quatf(quaternion)]), time_code)
    curves = add_curves(stage, "/World/Body/Hair", line(6, (0.2, 0, 0), (0.5, 0, 0)))
    transform(curves, (0, 0.1, 0))
    binding = UsdSkel.BindingAPI.Apply(curves.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/World/Body/Skel"])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(["/World/Body/Anim"])
    count = 1 if rigid else 6
    binding.CreateJointIndicesPrimvar(rigid, 1).Set([0] * count)
    binding.CreateJointWeightsPrimvar(rigid, 1).Set([1.0] * count)
    return curves


@pytest.mark.parametrize("flatten", [False, True])
@pytest.mark.parametrize("rigid", [False, True])
def test_roots_go_where_the_skinned_ones_go(tmp_path, rigid, flatten):
    stage = new_stage(tmp_path / "a.usda")
    rig(stage, rigid=rigid)
    stage.Save()
    result, source, stats = simulated(tmp_path / "a.usda", flatten=flatten, check=False)
    assert not source.left
    path = "/World/Body/Hair"
    np.testing.assert_allclose(world(result, path, 0), shown(tmp_path / "a.usda", path, 0), atol=2e-6)
    out = result.GetRootLayer().identifier
    for time_code in (0, 11, 23):
        there = world(result, path, time_code)
        np.testing.assert_allclose(there[0], shown(tmp_path / "a.usda", path, time_code)[0], atol=2e-6)
        np.testing.assert_allclose(shown(out, path, time_code), there, atol=2e-6)
    assert np.linalg.norm(world(result, path, 23)[0] - world(result, path, 0)[0]) > 0.3, "the root did go somewhere"
    assert stats.max_stretch < 1e-4


def test_blend_shapes(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = rig(stage, turn=0.0)
    shape = UsdSkel.BlendShape.Define(stage, "/World/Body/Hair/Lift")
    shape.CreateOffsetsAttr([(0, 0.3, 0)] * 2)
    shape.CreatePointIndicesAttr([0, 1])
    binding = UsdSkel.BindingAPI(curves.GetPrim())
    binding.CreateBlendShapesAttr(["lift"])
    binding.CreateBlendShapeTargetsRel().SetTargets(["/World/Body/Hair/Lift"])
    animation = UsdSkel.Animation.Get(stage, "/World/Body/Anim")
    animation.CreateBlendShapesAttr(["lift"])
    weights = animation.CreateBlendShapeWeightsAttr()
    weights.Set([0.0], 0)
    weights.Set([1.0], 20)
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", check=False)
    assert not source.left
    path = "/World/Body/Hair"
    for time_code in (0, 13, 23):
        root = shown(tmp_path / "a.usda", path, time_code)[0]
        np.testing.assert_allclose(world(result, path, time_code)[0], root, atol=2e-6)
        np.testing.assert_allclose(
            shown(result.GetRootLayer().identifier, path, time_code), world(result, path, time_code), atol=2e-6
        )
    lifted = world(result, path, 23)[0, 1] - world(result, path, 0)[0, 1]
    assert lifted == pytest.approx(2 * 0.3, abs=1e-5)


def test_what_does_not_fit_is_left(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = rig(stage)
    add_curves(stage, "/World/Other", line())
    UsdSkel.BindingAPI(curves.GetPrim()).GetJointIndicesPrimvar().Set([7] * 6)
    stage.Save()
    source = load_stage(tmp_path / "a.usda")
    assert [each.path for each in source.curves] == ["/World/Other"]
    assert source.left[0].startswith("/World/Body/Hair is left as it is: the joint indices and weights do not fit")


def test_the_file_with_a_skinned_hair(tmp_path):
    path = tmp_path / "skinned_hair.usda"
    path.write_text((DATA / "skinned_hair.usda").read_text())
    result, _, stats = simulated(path, check=False)
    first = local(result, "/Body/Hair", 0)
    np.testing.assert_allclose(first, [(-0.05 * k, 0.05 * k, 0) for k in range(6)], atol=1e-6)  # turned by 90 degrees
    np.testing.assert_array_equal(local(result, "/Body/Hair", 120)[0], 0.0)
    assert min(local(result, "/Body/Hair", t)[-1, 1] for t in range(121)) < -0.25, "it swings below its root"
    assert stats.max_stretch < 1e-5


def test_hermite_curves_cannot_be_skinned(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = rig(stage)
    curves.GetPrim().SetTypeName("HermiteCurves")
    UsdGeom.HermiteCurves(curves.GetPrim()).CreateTangentsAttr([(0.1, 0, 0)] * 6)
    stage.Save()
    with pytest.raises(pbd.InputError, match="bound to a skeleton, which does not deform the tangents"):
        load_stage(tmp_path / "a.usda")


def test_what_else_moves_them_is_named(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/Box/C", line())
    UsdPhysics.RigidBodyAPI.Apply(stage.GetPrimAtPath("/World/Box"))
    add_curves(stage, "/World/Free", line())
    stage.Save()
    (note,) = load_stage(tmp_path / "a.usda").notes
    assert note == "/World/Box/C: PhysicsRigidBodyAPI of /World/Box may move it once more where that is evaluated"
