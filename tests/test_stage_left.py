"""What cannot be simulated is left as it is, with a warning that names it; the rest goes on."""

import json
import sys
from contextlib import contextmanager

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, Vt
from stages import add_curves, line, local, new_stage, simulated
from typer.testing import CliRunner

import pbd_warp as pbd
from pbd_warp.cli import app, main
from pbd_warp.cli.terminal import as_options
from pbd_warp.curves import Material, StageHooks, load_stage, simulate
from pbd_warp.curves.playback import Playback


def put(curves, points):
    curves.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(np.asarray(points, np.float32)))


def one_point(stage, curves):
    curves.GetCurveVertexCountsAttr().Set([1, 5])


def no_point(stage, curves):
    curves.GetCurveVertexCountsAttr().Set([0, 6])


def not_finite(stage, curves):
    points = line(6)
    points[2, 1] = np.nan
    curves.GetCurveVertexCountsAttr().Set([3, 3])
    put(curves, points)


def one_place(stage, curves):
    curves.GetCurveVertexCountsAttr().Set([3, 3])
    put(curves, line(6)[[0, 0, 0, 3, 4, 5]])


def bad_width(stage, curves):
    curves.GetCurveVertexCountsAttr().Set([3, 3])
    curves.GetWidthsAttr().Set([float("nan"), 0.1])
    curves.SetWidthsInterpolation("uniform")


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (one_point, "it has 1 control points; a nonperiodic linear curve needs 2 or more"),
        (no_point, "it has 0 control points; a nonperiodic linear curve needs 2 or more"),
        (not_finite, "points at time code 0 must be finite, but number 2 is (0.4, nan, 0)"),
        (one_place, "its 3 points lie in 1 places; a nonperiodic linear curve needs 2 or more"),
        (bad_width, "one of its widths is not finite"),
    ],
)
@pytest.mark.parametrize("flatten", [False, True])
def test_one_curve_of_a_prim(tmp_path, spoil, reason, flatten):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line(6))
    spoil(stage, curves)
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", flatten=flatten, check=False)
    assert source.left == [f"/World/C: curve 0 is left as it is: {reason}"]
    first = curves.GetCurveVertexCountsAttr().Get()[0]
    before, after = local(stage, "/World/C", 0), local(result, "/World/C", 20)
    np.testing.assert_array_equal(after[:first], before[:first])
    np.testing.assert_array_equal(local(result, "/World/C", 20, "velocities")[:first], 0.0)
    assert np.abs(after[first + 1 :] - before[first + 1 :]).min(axis=0)[1] > 0.01
    with pytest.raises(pbd.InputError, match="curve 0 is left as it is"):
        load_stage(tmp_path / "a.usda", strict=True)


def test_a_curve_that_is_left_goes_on_with_the_inputs_animation(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line(6))
    curves.GetCurveVertexCountsAttr().Set([1, 5])
    for time_code in range(24):
        curves.GetPointsAttr().Set(
            line(6, (0, 0, 0.01 * time_code), (1, 0, 0.01 * time_code)).astype(np.float32), time_code
        )
    stage.Save()
    result, _, _ = simulated(tmp_path / "a.usda", check=False)
    np.testing.assert_array_equal(local(result, "/World/C", 13)[0], local(stage, "/World/C", 13)[0])


@pytest.mark.parametrize("wrap", ["nonperiodic", "periodic"])
def test_points_that_lie_in_one_place_move_together(tmp_path, wrap):
    """Roots, tips and inner points given twice or three times, and a loop whose end is its beginning once more."""
    for name, copies in ("once", [1, 1, 1, 1]), ("often", [3, 1, 2, 2]):
        stage = new_stage(tmp_path / f"{name}.usda")
        corners = np.array([(0, 0, 0), (0.3, 0, 0), (0.3, 0, 0.3), (0, 0, 0.4)])
        points = np.repeat(corners, copies, axis=0)
        if name == "often" and wrap == "periodic":
            points = np.concatenate([points, corners[:1], corners[:1]])
        add_curves(stage, "/World/C", points, wrap=wrap)
        stage.Save()
    once, _, _ = simulated(tmp_path / "once.usda")
    often, source, _ = simulated(tmp_path / "often.usda")
    assert len(source.curves[0].x) == 4
    for time_code in range(24):
        expected = np.repeat(local(once, "/World/C", time_code), [3, 1, 2, 2], axis=0)
        np.testing.assert_array_equal(local(often, "/World/C", time_code)[:8], expected)


def instanced(stage):
    add_curves(stage, "/Proto/Fern", line())
    copy = stage.DefinePrim("/World/Copy")
    copy.GetReferences().AddInternalReference("/Proto")
    copy.SetInstanceable(True)
    return {"/World/Copy/Fern": "it is part of an instance", "/Proto/Fern": "/World/Copy/Fern takes it over"}


def scattered(stage):
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/Field")
    add_curves(stage, "/World/Field/Blade", line())
    instancer.CreatePrototypesRel().AddTarget("/World/Field/Blade")
    return {"/World/Field/Blade": "it is a prototype of a PointInstancer"}


def does_not_add_up(stage):
    add_curves(stage, "/World/Bad", line(), counts=[7])
    return {"/World/Bad": "curveVertexCounts add up to 7"}


@pytest.mark.parametrize("spoil", [instanced, scattered, does_not_add_up])
def test_one_prim_of_a_stage(tmp_path, spoil):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line())
    expected = spoil(stage)
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", check=False)
    assert [curves.path for curves in source.curves] == ["/World/C"]
    assert len(source.left) == len(expected)
    for path, reason in expected.items():
        assert any(text.startswith(f"{path} is left as it is: {reason}") for text in source.left)
        np.testing.assert_array_equal(local(result, path, 20), local(stage, path, 20))
    with pytest.raises(pbd.InputError, match="is left as it is"):
        load_stage(tmp_path / "a.usda", strict=True)


def test_skip(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    for name in "ABC":
        add_curves(stage, f"/World/{name}/Rope", line())
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", skip=["/World/B", "*/C/Rope"])
    assert [curves.path for curves in source.curves] == ["/World/A/Rope"]
    assert not source.left, "asked for, so nothing to warn of"
    np.testing.assert_array_equal(local(result, "/World/B/Rope", 20), local(stage, "/World/B/Rope", 0))
    for skip, message in (["/World/D"], "--skip /World/D matches no curves"), (["/World"], "--skip /World leaves no"):
        with pytest.raises(pbd.InputError, match=message):
            load_stage(tmp_path / "a.usda", skip=skip)


@pytest.mark.parametrize(
    ("widths", "interpolation", "expected"),
    [
        ([0.3], None, [0.3] * 6),
        ([0.3], "vertex", [0.3] * 6),
        ([0.1, 0.2], None, [0.1] * 4 + [0.2] * 2),
        ([0.4, 0.3, 0.2, 0.0, 0.1, 0.0], None, [0.4, 0.3, 0.2, 0.004, 0.1, 0.001]),
        ([0.0], "constant", [0.01] * 6),
        ([-1.0], "constant", [0.01] * 6),
        ([0.1] * 5, "vertex", [0.01] * 6),
    ],
)
def test_widths_that_exporters_write(tmp_path, widths, interpolation, expected):
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line(6), counts=[4, 2], width=None)
    curves.CreateWidthsAttr(widths)
    if interpolation:
        curves.SetWidthsInterpolation(interpolation)
    stage.Save()
    source = load_stage(tmp_path / "a.usda")
    np.testing.assert_allclose(source.curves[0].width, expected, rtol=1e-6)
    assert len(source.left) == (len(widths) == 5)
    if source.left:
        assert (
            "widths must be 6 for interpolation 'vertex', but there are 5: it is simulated as 10 mm" in source.left[0]
        )


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"frames": 1}, "one frame shows the curves as they are"),
        ({"pin": "primvar:all"}, "every point is pinned"),
        ({"gravity": 0.0}, "there is no gravity, and no pinned point moves"),
        ({"prims": ["/World/Down"], "dtype": "float64"}, "the curves hang at rest"),
    ],
)
def test_a_run_in_which_nothing_moves_says_why(tmp_path, options, why):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/Down", line(4, (0, 0, 0), (0, -0.75, 0)))
    primvar = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World/Down")).CreatePrimvar("all", Sdf.ValueTypeNames.Int)
    primvar.Set(1)
    if "prims" not in options:
        side = add_curves(stage, "/World/C", line())
        UsdGeom.PrimvarsAPI(side).CreatePrimvar("all", Sdf.ValueTypeNames.Int).Set(1)
    stage.Save()
    notes = []
    material = Material(options.pop("pin", None))
    source = load_stage(tmp_path / "a.usda", material=material, **options)
    simulate(source, tmp_path / "o.usda", hooks=StageHooks(on_note=notes.append))
    assert len(notes) == 1
    assert notes[0].startswith(f"nothing moved: {why}")


def thrown(tmp_path, names="AB"):
    """Curves of which the first of A breaks: its root is thrown away within a frame."""
    stage = new_stage(tmp_path / "a.usda", last=60)
    for name in names:
        points = np.concatenate([line(4), line(4, (0, 0, 1), (1, 0, 1))])
        curves = add_curves(stage, f"/World/{name}", points, counts=[4, 4])
        if name == "A":
            for time_code in (*range(40), 40, 60):
                points[0] = (3e38, 0, 0) if time_code == 40 else (0, 0, 0)
                put_at = Vt.Vec3fArray.FromNumpy(points.astype(np.float32))
                curves.GetPointsAttr().Set(put_at, time_code)
    stage.Save()
    return stage


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_curve_that_fails_is_left_and_the_others_are_kept(tmp_path):
    stage = thrown(tmp_path)
    notes = []
    source = load_stage(tmp_path / "a.usda")
    stats = simulate(source, tmp_path / "o.usda", hooks=StageHooks(on_note=notes.append))
    assert stats.particles == 12
    (note,) = notes
    assert note.startswith("curve 0 of /World/A left as in the input, as the simulation failed: frame 40 ")
    result = Usd.Stage.Open(str(tmp_path / "o.usda"))
    for time_code in (10, 50):
        expected = local(stage, "/World/A", time_code)[:4]
        np.testing.assert_array_equal(local(result, "/World/A", time_code)[:4], expected)
    assert local(result, "/World/A", 10)[7, 1] < -0.2
    assert UsdGeom.BasisCurves.Get(result, "/World/B").GetPointsAttr().GetTimeSamples() == list(range(61))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.usda", "o.usda"]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_under_strict_it_fails_by_the_name_of_the_curve(tmp_path):
    thrown(tmp_path)
    with pytest.raises(pbd.SimulationFailed, match=r"point \d of curve 0 of /World/A") as error:
        simulate(load_stage(tmp_path / "a.usda"), tmp_path / "o.usda", strict=True)
    assert "particle" not in str(error.value)
    assert "the 40 frames so far are in" in str(error.value)


def test_points_in_words(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/A", line(4), counts=[2, 2])
    add_curves(stage, "/World/B", line(7), basis="bezier")
    stage.Save()
    source = load_stage(tmp_path / "a.usda")
    words = Playback(source, source.scene.builder.finalize()).in_words
    assert words("particle 3 has left") == "point 1 of curve 1 of /World/A has left"
    assert words("of particles 4 and 5, off") == "of point 0 and point 1 of curve 0 of /World/B, off"
    assert words("distance 1 is stretched") == "the link from point 0 and point 1 of curve 1 of /World/A is stretched"


def test_settings_in_the_command_lines_spelling():
    assert as_options("use on_failure='subdivide', or") == "use --on-failure subdivide, or"
    assert as_options("give Simulation or Scene max_contacts=40 or more") == "give --max-contacts 40 or more"
    assert as_options("with Direct(iterations=30), 'pbd'") == "with Direct(iterations=30), 'pbd'"


def test_the_command_line_tells_what_is_left_and_how_long_each_phase_took(tmp_path, monkeypatch, capfd):
    stage = new_stage(tmp_path / "a.usda", last=0)
    curves = add_curves(stage, "/World/C", line(6))
    one_point(stage, curves)
    add_curves(stage, "/World/D", line(6))
    stage.Save()
    command = [
        "pbd-warp",
        "simulate",
        str(tmp_path / "a.usda"),
        "--out",
        str(tmp_path / "o.usda"),
        "--skip",
        "/World/D",
    ]
    command += ["--stats", str(tmp_path / "s.json")]
    monkeypatch.setattr(sys, "argv", command)
    with pytest.raises(SystemExit) as stop:
        main()
    out, err = capfd.readouterr()
    assert stop.value.code == 0, err
    lines = [text for text in err.splitlines() if text.startswith("pbd-warp: ")]
    assert lines[0].startswith("pbd-warp: the stage's time codes 0 to 0 are a single frame")
    assert lines[1].startswith("pbd-warp: /World/C: curve 0 is left as it is: it has 1 control points")
    assert json.loads((tmp_path / "s.json").read_text())["frames"] == 121
    spent = out.splitlines()[-1].split()
    assert spent[0] == "time"
    assert set(spent) >= {"reading", "solving", "writing"}
    monkeypatch.setattr(sys, "argv", [*command, "--strict"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert "curve 0 is left as it is" in capfd.readouterr().err


def test_the_progress_bar_tells_reading_solving_and_writing_apart(tmp_path, monkeypatch):
    """Reading once, then each frame is solved and written, and in the end everything is merged."""
    stage = new_stage(tmp_path / "a.usda", last=3)
    add_curves(stage, "/World/C", line(6))
    stage.Save()
    said = []

    @contextmanager
    def bar(title):
        yield lambda done, of, doing="": said.append((done, of, doing))

    monkeypatch.setattr("pbd_warp.cli.simulate.progress_bar", bar)
    result = CliRunner().invoke(app, ["simulate", str(tmp_path / "a.usda"), "--out", str(tmp_path / "o.usda")])
    assert result.exit_code == 0, result.output
    assert said == [
        (0, None, "reading"),
        *((done, 4, doing) for done in range(4) for doing in ("writing", "solving")),
        (4, 4, "writing"),
    ]


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), -0.5])
def test_widths_are_checked_at_every_frame(tmp_path, bad):
    """What USD makes of bad ones is an extent that is not finite, or with its ends swapped."""
    stage = new_stage(tmp_path / "a.usda")
    curves = add_curves(stage, "/World/C", line(6))
    for time, width in ((0, 0.02), (4, 0.02), (5, bad), (6, 0.02)):
        curves.GetWidthsAttr().Set([width], time)
    stage.Save()
    result, source, _ = simulated(tmp_path / "a.usda", check=False)
    assert any(f"width 0 is {bad:g} at time code 5: in extents it counts as 0" in text for text in source.left)
    for time in range(24):
        extent = local(result, "/World/C", time, "extent")
        assert np.isfinite(extent).all()
        assert np.all(extent[0] <= extent[1])


def test_an_attribute_of_another_type_is_named(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line(6))
    add_curves(stage, "/World/D", line(6))
    layer = stage.GetRootLayer()
    del layer.GetPrimAtPath("/World/C").properties["widths"]
    Sdf.AttributeSpec(layer.GetPrimAtPath("/World/C"), "widths", Sdf.ValueTypeNames.StringArray).default = ["a"]
    stage.Save()
    _, source, _ = simulated(tmp_path / "a.usda", check=False)
    assert source.left == ["/World/C is left as it is: /World/C.widths is string[], where USD has float[]"]


def test_what_would_not_open_again_is_not_flattened(tmp_path):
    stage = new_stage(tmp_path / "a.usda")
    add_curves(stage, "/World/C", line(6))
    cube = UsdGeom.Cube.Define(stage, "/World/Cube").GetPrim()
    spec = stage.GetRootLayer().GetPrimAtPath(cube.GetPath())
    Sdf.AttributeSpec(spec, "visibility", Sdf.ValueTypeNames.Bool).default = True
    stage.Save()
    message = "cannot be flattened: /World/Cube.visibility is bool, where USD has token"
    with pytest.raises(pbd.InputError, match=message):
        simulated(tmp_path / "a.usda", flatten=True)
    result, _, _ = simulated(tmp_path / "a.usda", check=False)
    assert result.GetPrimAtPath("/World/C")
