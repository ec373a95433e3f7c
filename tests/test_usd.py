"""Every scene exported, reopened, validated; files that are whole or not there."""

import errno
import os
import tempfile

import numpy as np
import pytest
from models import rope_model, samples
from pxr import Gf, Usd, UsdGeom, UsdLux, UsdValidation

import pbd_warp as pbd
from pbd_warp.run import run

FRAMES = 24


@pytest.fixture(
    scope="module",
    params=[(name, ".usda") for name in pbd.scene_names()] + [("rope", ".usdc"), ("worm", ".usd")],
    ids="".join,
)
def exported(request, tmp_path_factory):
    name, suffix = request.param
    path = tmp_path_factory.mktemp("usd") / f"{name}{suffix}"
    scene = pbd.load_scene(name).changed(frames=FRAMES)
    stats = run(scene, path)
    return scene, Usd.Stage.Open(str(path)), stats


def geometries(stage):
    return [UsdGeom.PointBased(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.PointBased)]


def test_every_validator_passes(exported):
    _, stage, _ = exported
    registry = UsdValidation.ValidationRegistry()
    validators = registry.GetOrLoadAllValidators()
    assert len(validators) > 10
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [f"{e.GetName()}: {e.GetMessage()}" for e in errors] == []


def test_the_validators_notice_a_broken_stage():
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.Points.Define(stage, "/Points")
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert context.Validate(stage)


def test_stage_metadata_and_provenance(exported):
    scene, stage, _ = exported
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == scene.fps
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, FRAMES - 1)
    assert str(stage.GetDefaultPrim().GetPath()) == "/World"
    assert Usd.ModelAPI(stage.GetDefaultPrim()).GetKind() == "component"
    data = stage.GetRootLayer().customLayerData
    assert data["scene"] == scene.name
    assert data["version"] == pbd.__version__
    assert {"method", "integrator", "substeps", "iterations", "dtype", "device"} <= set(data)


def test_time_codes_are_the_integers(exported):
    _, stage, _ = exported
    for geometry in geometries(stage):
        for attribute in (geometry.GetPointsAttr(), geometry.GetVelocitiesAttr(), geometry.GetExtentAttr()):
            assert attribute.GetTimeSamples() == list(range(FRAMES))
            assert attribute.Get() is None, "no default beside the samples"


def test_points_and_curves_say_the_same_as_the_simulation(exported, tmp_path):
    scene, stage, _ = exported
    points = UsdGeom.Points.Get(stage, "/World/Particles")
    model = scene.builder.finalize()
    n = model.particle_count
    assert list(points.GetIdsAttr().Get()) == list(range(n))
    np.testing.assert_allclose(points.GetWidthsAttr().Get(), 2 * model.radius, rtol=1e-6)
    np.testing.assert_allclose(points.GetPointsAttr().Get(0), model.x, atol=1e-6)
    moved = np.array(points.GetPointsAttr().Get(FRAMES - 1))
    at_rest = ("catenary", "hanging", "long_rope", "capstan", "cable")
    assert (np.abs(moved - model.x).max() > 1e-4) != (scene.name in at_rest)
    np.testing.assert_allclose(points.GetVelocitiesAttr().Get(0), model.v, atol=1e-6)
    curves = UsdGeom.BasisCurves.Get(stage, "/World/Ropes")
    assert bool(curves) == bool(model.ropes)
    if curves:
        assert list(curves.GetCurveVertexCountsAttr().Get()) == [len(rope) for rope in model.ropes]
        assert not curves.GetCurveVertexCountsAttr().ValueMightBeTimeVarying()
        assert (curves.GetTypeAttr().Get(), curves.GetWrapAttr().Get()) == ("linear", "nonperiodic")
        index = np.concatenate(model.ropes)
        np.testing.assert_array_equal(np.array(curves.GetPointsAttr().Get(FRAMES - 1)), moved[index])
        assert curves.GetWidthsInterpolation() == "vertex"
        assert len(curves.GetWidthsAttr().Get()) == len(index)


def test_extents_are_what_usd_itself_computes(exported):
    _, stage, _ = exported
    checked = 0
    for prim in stage.Traverse():
        if boundable := UsdGeom.Boundable(prim):
            for time in [Usd.TimeCode(t) for t in range(FRAMES)]:
                stored = boundable.GetExtentAttr().Get(time)
                computed = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, time)
                if computed is not None:
                    np.testing.assert_array_equal(np.array(stored), np.array(computed))
                    checked += 1
    assert checked >= FRAMES


def test_the_camera_sees_all_of_every_frame(exported):
    _, stage, _ = exported
    camera = UsdGeom.Camera.Get(stage, "/World/Camera").GetCamera(Usd.TimeCode(0))
    frustum = camera.frustum
    for geometry in geometries(stage):
        for time in range(FRAMES):
            low, high = geometry.GetExtentAttr().Get(time)
            for corner in np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T:
                assert frustum.Intersects(Gf.Vec3d(*map(float, corner)))
    assert any(prim.HasAPI(UsdLux.LightAPI) for prim in stage.Traverse())


def test_colliders_are_drawn_where_they_are(tmp_path):
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 1, 0), radius=0.1)
    builder.add_plane((0, -0.5, 0), (1, 1, 0))
    builder.add_sphere((1, 2, 3), 0.25)
    model = builder.finalize()
    with pbd.UsdWriter(tmp_path / "c.usda", model) as writer:
        writer.write(pbd.Simulation(model).state)
    stage = Usd.Stage.Open(str(tmp_path / "c.usda"))
    plane = UsdGeom.Plane.Get(stage, "/World/Colliders/Plane_0")
    matrix = UsdGeom.Xformable(plane).ComputeLocalToWorldTransform(0)
    normal = np.array(matrix.TransformDir(Gf.Vec3d(0, 0, 1)))
    np.testing.assert_allclose(normal, np.array([1, 1, 0]) / np.sqrt(2), atol=1e-6)
    assert np.array(matrix.ExtractTranslation()) @ [1, 1, 0] == pytest.approx(-0.5, abs=1e-6)
    sphere = UsdGeom.Sphere.Get(stage, "/World/Colliders/Sphere_1")
    assert sphere.GetRadiusAttr().Get() == 0.25
    assert tuple(UsdGeom.Xformable(sphere).ComputeLocalToWorldTransform(0).ExtractTranslation()) == (1, 2, 3)


def test_edges_outside_ropes_are_curves_of_two(tmp_path):
    builder = pbd.ModelBuilder()
    rope = builder.add_rope(np.eye(3))
    builder.add_graph(2 * np.eye(3), [(0, 1), (1, 2), (2, 0)])
    builder.add_distance(rope[0], rope[2])
    model = builder.finalize()
    with pbd.UsdWriter(tmp_path / "e.usda", model) as writer:
        writer.write(pbd.Simulation(model).state)
    stage = Usd.Stage.Open(str(tmp_path / "e.usda"))
    edges = UsdGeom.BasisCurves.Get(stage, "/World/Edges")
    assert list(edges.GetCurveVertexCountsAttr().Get()) == [2] * 4
    assert min(edges.GetWidthsAttr().Get()) > 0


# Whole or not there.


def write_frames(path, model, count, error=None):
    sim = pbd.Simulation(model)
    with pbd.UsdWriter(path, model) as writer:
        for _ in range(count):
            writer.write(sim.state)
            sim.step()
        if error:
            raise error
    return writer


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
@pytest.mark.parametrize("error", [KeyboardInterrupt(), pbd.SimulationFailed("no")], ids=["ctrl-c", "failure"])
def test_an_unfinished_run_keeps_its_frames_and_the_old_file(tmp_path, suffix, error):
    path, model = tmp_path / f"a{suffix}", rope_model(dtype="float32")
    with pytest.raises(type(error)):
        write_frames(path, model, 3, error)
    assert samples(path) == [0, 1, 2], "there was none: the frames so far have its name"
    write_frames(path, model, 5)
    with pytest.raises(type(error)):
        write_frames(path, model, 2, error)
    assert samples(path) == [0, 1, 2, 3, 4], "the finished one stays"
    assert samples(tmp_path / f"a.partial{suffix}") == [0, 1]
    assert len(list(tmp_path.iterdir())) == 2


def test_the_old_file_stays_whole_until_the_new_one_is_complete(tmp_path):
    path, model = tmp_path / "a.usda", rope_model(dtype="float32")
    write_frames(path, model, 2)
    old = path.read_bytes()
    sim = pbd.Simulation(model)
    with pbd.UsdWriter(path, model) as writer:
        for _ in range(4):
            writer.write(sim.state)
        assert path.read_bytes() == old
    assert samples(path) == [0, 1, 2, 3]


def test_a_file_that_cannot_be_finished_is_an_error_and_the_old_one_stays(tmp_path, monkeypatch):
    path, model = tmp_path / "a.usda", rope_model(dtype="float32")
    write_frames(path, model, 2)
    old = path.read_bytes()

    def full(descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(pbd.SimulationFailed, match=r"a\.usda could not be written: .*No space left on device"):
        write_frames(path, model, 4)
    assert path.read_bytes() == old
    assert [p.name for p in tmp_path.iterdir()] == ["a.usda"]


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
@pytest.mark.parametrize("done", [1, 40, 64, 70])
def test_a_resumed_run_equals_an_uninterrupted_one(tmp_path, suffix, done):
    """Camera and colliders included, which depend on all of the motion."""
    scene = pbd.load_scene("collision")
    model = scene.builder.finalize()

    def frames(count):
        sim = pbd.Simulation(model, substeps=4)
        for _ in range(count):
            yield sim.state
            sim.step()

    path = tmp_path / f"a{suffix}"
    with pbd.UsdWriter(path, model) as writer:
        for state in frames(75):
            writer.write(state)
    expected = path.read_bytes()
    path.unlink()
    killed = pbd.UsdWriter(path, model)
    for state in frames(72):
        killed.write(state)
    killed.flush()
    assert samples(tmp_path / f"a.partial{suffix}") == list(range(72))
    del killed
    with pbd.UsdWriter(path, model, resume=done) as writer:
        assert writer.frames == done
        assert samples(tmp_path / f"a.partial{suffix}") == list(range(done))
        for number, state in enumerate(frames(75)):
            if number >= done:
                writer.write(state)
    assert path.read_bytes() == expected
    assert len(list(tmp_path.iterdir())) == 1


def test_what_is_not_finite_is_not_written(tmp_path):
    model = rope_model(dtype="float32")
    sim = pbd.Simulation(model)
    writer = pbd.UsdWriter(tmp_path / "a.usda", model)
    writer.write(sim.state)
    sim.state.x.fill_(sim._context.vec3(np.nan, 0, 0))
    with pytest.raises(pbd.SimulationFailed, match="frame 1 is not finite"):
        writer.write(sim.state)
    writer.close()
    assert samples(tmp_path / "a.usda") == [0]


def test_a_folder_that_cannot_be_written_to(tmp_path, monkeypatch):
    def refuse(**arguments):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    with pytest.raises(pbd.InputError, match="cannot be written to: Permission denied"):
        pbd.UsdWriter(tmp_path / "a.usda", rope_model())


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.abc", "must end in one of .usda, .usdc, .usd, not in '.abc'"),
        ("a", "not in 'nothing'"),
        ("no/folder/a.usda", "no/folder does not exist"),
        (".", "must end in"),
        ("folder.usda", "is a folder"),
    ],
)
def test_paths_that_cannot_be_written(tmp_path, name, message):
    (tmp_path / "folder.usda").mkdir()
    with pytest.raises(pbd.InputError, match=message):
        pbd.UsdWriter(tmp_path / name, rope_model())
