"""Geometry of a stage as colliders: where its transforms put it, mirrored, uneven, moved, in any unit and axis."""

import numpy as np
import pytest
from meshes import cuboid, volume
from pxr import Gf, Sdf, UsdGeom, UsdPhysics
from stages import add_curves, line, new_stage, simulated, transform

from pbd_warp.curves import load_stage
from pbd_warp.kernels.shapes import BOX, CAPSULE, CONE, MESH, SPHERE
from pbd_warp.model.rotation import rotate
from pbd_warp.model.tessellation import AROUND, tessellated


def define_mesh(stage, path, points, triangles):
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(points.astype(np.float32))
    mesh.CreateFaceVertexCountsAttr([3] * len(triangles))
    mesh.CreateFaceVertexIndicesAttr(np.asarray(triangles).ravel().tolist())
    return mesh


def a_solid(stage, name, axis):
    if name == "Mesh":
        return define_mesh(stage, "/World/Set/Solid", *cuboid((1.0, 2.0, 3.0)))
    solid = stage.DefinePrim("/World/Set/Solid", name)
    if name not in ("Cube", "Sphere"):
        solid.GetAttribute("axis").Set(axis)
    return UsdGeom.Gprim(solid)


def boundary(model, which, origin):
    """Points on a collider's surface in world space [m]."""
    c = model.colliders
    if c.kind[which] == MESH:
        points, triangles = c.mesh(which)
    else:
        points, triangles = tessellated(int(c.kind[which]), c.size[which])
    return rotate(c.rotation[which], points) + c.centre[which] + origin, triangles


KINDS = {"Cube": BOX, "Sphere": SPHERE, "Cylinder": CONE, "Cone": CONE, "Capsule": CAPSULE, "Mesh": MESH}


@pytest.mark.parametrize("up", ["Y", "Z"])
@pytest.mark.parametrize("scale", [(2, 2, 2), (-2, 2, 2), (1, 2, -3)], ids=["even", "mirrored", "uneven"])
@pytest.mark.parametrize("axis", ["X", "Z"])
@pytest.mark.parametrize("name", KINDS)
def test_it_is_where_its_transforms_put_it(tmp_path, name, axis, scale, up):
    stage = new_stage(tmp_path / "a.usda", up=up, metres=0.01)
    add_curves(stage, "/World/C", line(3, (0, 500, 0), (10, 500, 0)))
    transform(UsdGeom.Xform.Define(stage, "/World/Set"), (1, 20, 3), (20, 30, 40), (3, 3, 3))
    solid = a_solid(stage, name, axis)
    transform(solid, (1, 2, 3), (40, 10, 70), scale)
    stage.Save()
    source = load_stage(tmp_path / "a.usda", collide=["/World/Set"])
    model = source.scene.builder.finalize()
    keeps = name in ("Cube", "Mesh") or scale != (1, 2, -3)
    assert model.colliders.kind[0] == (KINDS[name] if keeps else MESH)
    points, triangles = boundary(model, 0, source.origin)
    assert volume(points, triangles) > 0.0, "seen counterclockwise from outside, mirrored or not"
    matrix = np.array(solid.ComputeLocalToWorldTransform(0))
    local = (points / 0.01 - matrix[3, :3]) @ np.linalg.inv(matrix[:3, :3])
    low, high = local.min(axis=0), local.max(axis=0)
    if name == "Mesh":
        extent = 0.5 * np.array([1.0, 2.0, 3.0])
    else:
        box = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(solid), 0)
        extent = np.array(box[1])
    sag = 1.0 - np.cos(np.pi / AROUND)  # of the polygon that is drawn for a circle
    np.testing.assert_allclose(high, extent, atol=1e-4, rtol=sag)
    np.testing.assert_allclose(low, -extent, atol=1e-4, rtol=sag)


@pytest.mark.parametrize("turned", [False, True])
def test_a_table_that_moves_takes_curves_along(tmp_path, turned):
    """A curve lies on a plate that is moved and turned; at the end it lies there as at the beginning."""
    stage = new_stage(tmp_path / "a.usda", up="Z", metres=0.01, last=24)
    curves = add_curves(stage, "/World/C", line(9, (5, 3, 0.5), (21, 3, 0.5)), width=1.0)
    plate = define_mesh(stage, "/World/Plate", *cuboid((100.0, 100.0, 4.0)))
    plate.GetPrim().CreateAttribute("pbd:friction", Sdf.ValueTypeNames.Float).Set(0.9)
    move, turn = plate.AddTranslateOp(), plate.AddRotateZOp()
    for frame in range(25):
        part = 0.5 - 0.5 * np.cos(np.pi * frame / 24.0)
        move.Set(Gf.Vec3d(20.0 * part, 0, -2), frame)
        turn.Set(60.0 * part if turned else 0.0, frame)
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", pin="none", collide=["/World/Plate"])
    assert source.scene.builder.finalize().colliders.moves.tolist() == [1]
    start, end = (np.array(UsdGeom.BasisCurves.Get(result, "/World/C").GetPointsAttr().Get(t)) for t in (0, 24))
    angle = np.radians(60.0) if turned else 0.0
    c, s = np.cos(angle), np.sin(angle)
    expected = start @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + (20.0, 0, 0)
    np.testing.assert_allclose(end, expected, atol=0.2)
    assert curves


def test_all_that_collides_in_physics(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line(3, (0, 5, 0), (1, 5, 0)))
    for name in ("A", "B", "C2"):
        UsdGeom.Cube.Define(stage, f"/World/Set/{name}")
    for name in ("A", "B"):
        UsdPhysics.CollisionAPI.Apply(stage.GetPrimAtPath(f"/World/Set/{name}"))
    UsdPhysics.CollisionAPI(stage.GetPrimAtPath("/World/Set/B")).CreateCollisionEnabledAttr(False)
    stage.Save()
    assert [each.path for each in load_stage(tmp_path / "a.usda", collide=["physics"]).colliders] == ["/World/Set/A"]


def test_a_mesh_is_taken_as_its_points_are(tmp_path):
    """Neither smoothed, as a renderer would, nor replaced by what a physics engine would put in its place."""
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line(3, (0, 5, 0), (1, 5, 0)))
    points, triangles = cuboid((1.0, 2.0, 3.0))
    mesh = define_mesh(stage, "/World/M", points, triangles)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.catmullClark)
    approximation = UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim()).CreateApproximationAttr()
    approximation.Set(UsdPhysics.Tokens.boundingSphere)
    stage.Save()
    model = load_stage(tmp_path / "a.usda", collide=["/World/M"]).scene.builder.finalize(dtype="float64")
    found, faces = boundary(model, 0, np.zeros(3))
    assert len(faces) == len(triangles)
    np.testing.assert_allclose(np.ptp(found, axis=0), np.ptp(points, axis=0), rtol=1e-6)


def test_a_group_with_curves_in_it_means_its_solids(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line(3, (0, 5, 0), (1, 5, 0)))
    UsdGeom.Cube.Define(stage, "/World/Box")
    stage.Save()
    assert [each.path for each in load_stage(tmp_path / "a.usda", collide=["/World"]).colliders] == ["/World/Box"]


def test_faces_are_fans_without_holes_and_left_handed_ones_are_turned(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line(3, (0, 5, 0), (1, 5, 0)))
    mesh = UsdGeom.Mesh.Define(stage, "/World/M")
    mesh.CreatePointsAttr([(0, 0, 0), (0, 0, 1), (1, 0, 2), (2, 0, 1), (2, 0, 0), (5, 0, 0), (5, 0, 1), (6, 0, 0)])
    mesh.CreateFaceVertexCountsAttr([5, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 4, 5, 6, 7])
    mesh.CreateHoleIndicesAttr([1])
    mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    stage.Save()
    model = load_stage(tmp_path / "a.usda", collide=["/World/M"]).scene.builder.finalize()
    points, triangles = model.colliders.mesh(0)
    assert triangles.tolist() == [[2, 1, 0], [3, 2, 0], [4, 3, 0]]
    assert model.colliders.size[0, 0] == 0.0
    a, b, c = points[triangles].transpose(1, 0, 2)
    assert np.all(np.cross(b - a, c - a)[:, 1] < 0.0)


def test_curves_stay_out_of_what_moves_through_them(tmp_path):
    """A ball of triangles goes through a hanging curtain of hair; no point is ever inside."""
    stage = new_stage(tmp_path / "a.usda", last=36)
    for k in range(5):
        add_curves(stage, f"/World/H{k}", line(12, (0.1 * k, 1, 0), (0.1 * k, 0.3, 0)), width=0.02)
    ball = define_mesh(stage, "/World/Ball", *tessellated(SPHERE, np.array([0.15, 0, 0])))
    move = ball.AddTranslateOp()
    for frame in range(37):
        move.Set(Gf.Vec3d(0.2, 0.5, -0.5 + frame / 36.0), frame)
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda", collide=["/World/Ball"])
    moved = 0.0
    for frame in range(37):
        centre = np.array([0.2, 0.5, -0.5 + frame / 36.0])
        for k in range(5):
            x = np.array(UsdGeom.BasisCurves.Get(result, f"/World/H{k}").GetPointsAttr().Get(frame))
            moved = max(moved, np.abs(x[:, 2]).max())
            assert np.linalg.norm(x - centre, axis=1).min() > 0.15 * np.cos(np.pi / 24) + 0.009
    assert moved > 0.1
