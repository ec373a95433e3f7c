"""Files with z up, in other units: the same world, turned by 90 degrees about x and measured otherwise."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdValidation
from test_cli import call

import pbd_warp as pbd

TURN = np.array(Gf.Matrix3d(Gf.Rotation(Gf.Vec3d.XAxis(), 90.0)))  # row vectors: y goes to z


def write(path, **options):
    builder = pbd.ModelBuilder()
    builder.add_rope(np.array([(0.3 * i, 1.0 + 0.1 * i * i, 0.2 * i) for i in range(4)]), radius=0.02)
    builder.add_plane((0, -1, 0), (0.2, 1, 0.1))
    builder.add_sphere((0.5, -0.5, 0.1), 0.3)
    sim = pbd.Simulation(builder.finalize(device="cpu"), substeps=4)
    with pbd.UsdWriter(path, sim.model, 24.0, **options) as writer:
        for _ in range(6):
            writer.write(sim.state)
            sim.step()
    return Usd.Stage.Open(str(path))


@pytest.mark.parametrize(("up", "metres"), [("Z", 1.0), ("Z", 0.01), ("Y", 0.01)])
def test_everything_is_where_it_was(tmp_path, up, metres):
    plain, other = write(tmp_path / "a.usda"), write(tmp_path / "b.usda", up_axis=up, meters_per_unit=metres)
    assert (UsdGeom.GetStageUpAxis(other), UsdGeom.GetStageMetersPerUnit(other)) == (up, metres)
    turn = TURN if up == "Z" else np.eye(3)
    compared = set()
    for prim in plain.Traverse():
        twin = other.GetPrimAtPath(prim.GetPath())
        if prim.IsA(UsdGeom.PointBased):
            for name in ("points", "velocities"):
                values, turned = (np.array(p.GetAttribute(name).Get(5), float) for p in (prim, twin))
                np.testing.assert_allclose(turned, values @ turn / metres, rtol=1e-6, atol=1e-6 / metres)
            widths = [np.array(p.GetAttribute("widths").Get()) for p in (prim, twin)]
            np.testing.assert_allclose(widths[1], widths[0] / metres, rtol=1e-6)
        elif prim.IsA(UsdGeom.Xformable):
            a, b = (np.array(UsdGeom.Xformable(p).ComputeLocalToWorldTransform(5)) for p in (prim, twin))
            np.testing.assert_allclose(b[3, :3], a[3, :3] @ turn / metres, atol=1e-6 / metres)
            if prim.IsA(UsdGeom.Plane):  # about its own axis it may be turned as it likes
                np.testing.assert_allclose(b[2, :3], a[2, :3] @ turn, atol=1e-6)
            elif not prim.IsA(UsdGeom.Sphere) and prim.GetName() != "World":
                np.testing.assert_allclose(b[:3, :3], a[:3, :3] @ turn, atol=1e-6)
            for name in ("radius", "width", "length", "clippingRange"):
                if prim.GetAttribute(name) and prim.GetAttribute(name).HasAuthoredValue():
                    values = [np.array(p.GetAttribute(name).Get()) for p in (prim, twin)]
                    np.testing.assert_allclose(values[1], values[0] / metres, rtol=1e-6)
        compared.add(prim.GetTypeName())
    assert compared >= {"Points", "BasisCurves", "Plane", "Sphere", "Camera", "DistantLight"}
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    assert not context.Validate(other)


def test_axes_and_units_that_are_none(tmp_path):
    for option, message in ({"up_axis": "X"}, "unknown up axis 'X'"), ({"meters_per_unit": 0.0}, "must be a finite"):
        with pytest.raises(pbd.InputError, match=message):
            write(tmp_path / "a.usda", **option)
    assert not list(tmp_path.iterdir())


def test_the_command_line(tmp_path):
    result = call("run", "rope", "--frames", 4, "--up", "z", "--out", "r.usda", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    stage = Usd.Stage.Open(str(tmp_path / "r.usda"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    velocities = np.array(UsdGeom.Points.Get(stage, "/World/Particles").GetVelocitiesAttr().Get(3))
    assert velocities[:, 2].min() < -0.1
    assert np.abs(velocities[:, 1]).max() < 0.1
    result = call("run", "rope", "--up", "x", "--out", "q.usda", cwd=tmp_path)
    assert (result.returncode, "unknown up axis 'X'" in result.stderr) == (2, True)
    assert not (tmp_path / "q.usda").exists()
