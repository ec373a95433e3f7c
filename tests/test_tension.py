"""Tensions beside the points of curves that are written: against statics, for every kind of curve."""

import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdValidation
from stages import add_curves, line, new_stage
from typer.testing import CliRunner

import pbd_warp as pbd
from pbd_warp.cli import app
from pbd_warp.curves import load_stage, simulate
from pbd_warp.run import run
from pbd_warp.usd.writer import UsdWriter

G = 9.81


def tensions(stage, path, frame=1):
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path)).GetPrimvar("tension")
    assert primvar.GetInterpolation() == "varying"
    return np.array(primvar.Get(frame))


def valid(stage):
    context = UsdValidation.ValidationContext(UsdValidation.ValidationRegistry().GetOrLoadAllValidators())
    return [f"{e.GetName()}: {e.GetMessage()}" for e in context.Validate(stage)] == []


def hanging_and_loose():
    """A rope of three links with 7, 6 and 4 kg below them, its first link given twice; and a bar with 3 kg below."""
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, -k, 0) for k in range(4)], mass=[0.0, 1.0, 2.0, 4.0], pinned=(0,))
    builder.add_distances([(0, 1)])
    builder.add_particles([(5, 0, 0), (5, -1, 0)], mass=[0.0, 3.0])
    builder.add_distances([(4, 5)])
    return pbd.Scene(builder, frames=3, method="direct")


@pytest.mark.parametrize("up", ["Y", "Z"])
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_a_point_has_the_mean_of_the_links_that_meet_there(suffix, up, tmp_path):
    path = tmp_path / f"t{suffix}"
    run(hanging_and_loose(), path, dtype="float64", up_axis=up, tension=True)
    stage = Usd.Stage.Open(str(path))
    assert valid(stage)
    links = G * np.array([7.0, 6.0, 4.0])
    expected = [links[0], links[:2].mean(), links[1:].mean(), links[2]]
    np.testing.assert_allclose(tensions(stage, "/World/Ropes"), expected, rtol=1e-6)
    np.testing.assert_allclose(tensions(stage, "/World/Edges"), [3 * G, 3 * G], rtol=1e-6)
    np.testing.assert_array_equal(tensions(stage, "/World/Ropes", 0), 0.0)
    assert not UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Particles")).GetPrimvar("tension")


def test_without_being_asked_none_are_written(tmp_path):
    run(hanging_and_loose(), tmp_path / "t.usda")
    assert "tension" not in (tmp_path / "t.usda").read_text()


KINDS = {
    "linear": (11, 10),
    "bezier": (10, 3),
    "bspline": (10, 7),
    "catmullRom": (10, 7),
}


@pytest.mark.parametrize("basis", KINDS)
@pytest.mark.parametrize("flatten", [False, True])
def test_a_hair_carries_what_hangs_below(basis, flatten, tmp_path):
    """A straight hair of 2 m, 3 kg, hangs from its first point: at a place on it the pull is what is below it. Evenly
    spaced control points make evenly spaced simulated ones, each of which has half of the links beside it."""
    points, segments = KINDS[basis]
    stage = new_stage(tmp_path / "hair.usda", last=3)
    reach = line(points, (0, 0, 0), (0, -2, 0))
    add_curves(stage, "/World/Hair", reach, basis=basis)
    stage.Save()
    out = tmp_path / "sim.usda"
    source = load_stage(tmp_path / "hair.usda", material=pbd.curves.Material(mass=3.0), dtype="float64")
    simulate(source, out, flatten, tension=True)
    result = Usd.Stage.Open(str(out))
    assert valid(result)
    found = tensions(result, "/World/Hair", 3)
    assert len(found) == segments + 1 == UsdGeom.BasisCurves.Get(result, "/World/Hair").ComputeVaryingDataSize(3)
    links = len(source.curves[0].x) - 1
    below = 1.0 - np.arange(segments + 1) / segments
    below[[0, -1]] += np.array([-0.5, 0.5]) / links  # at an end, that of its link
    np.testing.assert_allclose(found, 3.0 * G * below, rtol=1e-5)


def test_hermite_and_nurbs_curves_have_them_too(tmp_path):
    stage = new_stage(tmp_path / "k.usda", last=2)
    hermite = UsdGeom.HermiteCurves.Define(stage, "/World/Hermite")
    hermite.CreatePointsAttr([(0, -k, 0) for k in range(3)])
    hermite.CreateTangentsAttr([(0, -1, 0)] * 3)
    hermite.CreateCurveVertexCountsAttr([3])
    nurbs = UsdGeom.NurbsCurves.Define(stage, "/World/Nurbs")
    nurbs.CreatePointsAttr([(1, -k, 0) for k in range(6)])
    nurbs.CreateCurveVertexCountsAttr([6])
    nurbs.CreateOrderAttr([4])
    nurbs.CreateKnotsAttr(list(range(10)))
    stage.Save()
    source = load_stage(tmp_path / "k.usda", material=pbd.curves.Material(mass=2.0), dtype="float64")
    simulate(source, tmp_path / "s.usda", tension=True)
    result = Usd.Stage.Open(str(tmp_path / "s.usda"))
    np.testing.assert_allclose(tensions(result, "/World/Hermite"), 2 * G * np.array([11, 6, 1]) / 12, rtol=1e-5)
    np.testing.assert_allclose(tensions(result, "/World/Nurbs"), 2 * G * np.array([17, 12, 6, 1]) / 18, rtol=1e-5)


def test_doubled_points_share_theirs_and_curves_that_are_left_have_none(tmp_path):
    stage = new_stage(tmp_path / "d.usda", last=2)
    doubled = np.array([(0, 0, 0), (0, 0, 0), (0, -1, 0), (0, -2, 0), (0, -2, 0)], float)
    add_curves(stage, "/World/Hair", np.concatenate([[(3, 0, 0)], doubled, [(4, 0, 0), (4, -1, 0)]]), [1, 5, 2])
    stage.Save()
    source = load_stage(tmp_path / "d.usda", material=pbd.curves.Material(mass=1.0), dtype="float64")
    simulate(source, tmp_path / "s.usda", tension=True)
    found = tensions(Usd.Stage.Open(str(tmp_path / "s.usda")), "/World/Hair")
    np.testing.assert_allclose(found, G * np.array([0, 0.75, 0.75, 0.5, 0.25, 0.25, 0.5, 0.5]), rtol=1e-5)


def test_a_frame_made_again_has_the_tensions_of_what_made_it(rng):
    """Few iterations do not always arrive; where they do not, those of shorter steps do."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.cumsum(rng.normal(size=(12, 3)), axis=0), mass=1.0)
    model = builder.finalize(dtype="float64")
    sim = pbd.Simulation(model, method=pbd.Direct(iterations=2), on_failure="subdivide")
    for _ in range(100):
        x, v = sim.positions, sim.velocities
        sim.step()
        if sim.retried:
            break
    assert sim.retried == 1
    for substeps in (2, 4, 8, 16):
        other = sim.like(substeps=substeps, on_failure="raise")
        other.state.x.assign(x)
        other.state.v.assign(v)
        try:
            other.step()
        except pbd.SimulationFailed:
            continue
        break
    np.testing.assert_array_equal(sim.positions, other.positions)
    np.testing.assert_array_equal(sim.tension, other.tension)
    assert np.abs(sim.tension).min() > 0.0


def test_a_resumed_run_ends_with_the_same_tensions_and_one_without_does_not_go_on(tmp_path):
    asked = ["run", "chain", "--frames", "80", "--method", "direct", "--tension"]
    whole = CliRunner().invoke(app, [*asked, "--out", str(tmp_path / "whole.usda")])
    assert whole.exit_code == 0, whole.output
    kept = ["--checkpoint", str(tmp_path / "c.npz"), "--every", "40", "--out", str(tmp_path / "part.usda")]
    first = CliRunner().invoke(app, [*asked[:3], "50", *asked[4:], *kept])
    assert first.exit_code == 0, first.output
    refused = CliRunner().invoke(app, [*asked[:-1], *kept, "--resume"])
    assert refused.exit_code == 2, refused.output
    resumed = CliRunner().invoke(app, [*asked, *kept, "--resume"])
    assert resumed.exit_code == 0, resumed.output
    assert (tmp_path / "part.usda").read_bytes() == (tmp_path / "whole.usda").read_bytes()


@pytest.mark.parametrize("arguments", [["--method", "jacobi"], ["--method", "gauss-seidel"]])
def test_methods_that_do_not_know_them_are_refused(arguments, tmp_path):
    result = CliRunner().invoke(app, ["run", "chain", "--tension", *arguments, "--out", str(tmp_path / "x.usda")])
    assert result.exit_code == 2
    assert "tension is known with method 'direct'" in result.output
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_refused(tmp_path):
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 0, 0))
    with pytest.raises(pbd.InputError, match="no distances"):
        run(pbd.Scene(builder, frames=2, method="direct"), tmp_path / "x.usda", tension=True)
    model = hanging_and_loose().builder.finalize()
    with UsdWriter(tmp_path / "y.usda", model, tension=True) as writer:
        with pytest.raises(pbd.InputError, match="tensions are to be written"):
            writer.write(pbd.Simulation(model).state)
        writer.write(pbd.Simulation(model).state, np.zeros(len(model.distance)))
