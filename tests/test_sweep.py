"""Sweeps, and the command that charts them."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.accuracy.chart import load
from pbd_warp.accuracy.sweep import Sweep, _projections, charts_folder, sweep_scene
from pbd_warp.stability.maps import MAPS


@pytest.fixture(scope="module")
def pendulum():
    sweep = Sweep(substeps=(1, 4), iterations=(5,), errors=(1e-3, 1e-9), repeat=2)
    return sweep_scene(pbd.load_scene("pendulum"), sweep)


def test_every_configuration_has_its_row(pendulum):
    keys = [(r.method, r.integrator, r.dtype, r.substeps) for r in pendulum.rows if r.method != "none"]
    assert len(keys) == len(set(keys)) == 3 * 4 * 2 * 2
    explicit = {(r.dtype, r.error or r.substeps) for r in pendulum.rows if r.integrator == "dop853"}
    assert explicit == {(dtype, at) for dtype in ("float32", "float64") for at in (1, 4, 1e-3, 1e-9)} - {
        ("float32", 1e-9)
    }
    assert {r.integrator for r in pendulum.rows if r.method == "none"} == {"dop853", "rk4"}
    assert all(r.scene == "pendulum" for r in pendulum.rows)
    assert {r.iterations for r in pendulum.rows if r.method not in ("direct", "none")} == {5}
    assert {"reference", "machine", "versions", "date", "measured"} <= set(pendulum.info)


def test_rows_say_what_was_measured(pendulum):
    row = {(r.method, r.integrator, r.dtype, r.substeps): r for r in pendulum.rows}
    exact = row["direct", "midpoint4", "float64", 4]
    assert exact.position_error < 1e-6 < 1e-2 < row["direct", "pbd", "float64", 1].position_error
    assert exact.outcome == "converged"
    assert abs(exact.energy_drift) < 1e-9
    assert row["direct", "pbd", "float64", 1].energy_drift < -0.01
    jacobi = row["jacobi", "pbd", "float32", 4]
    assert jacobi.projections_per_sim_second == 60 * 4 * 5
    assert row["jacobi", "midpoint4", "float32", 4].projections_per_sim_second == 60 * 4 * 5 * 5
    assert all(r.wall_ms_per_sim_second > 0.0 and r.wall_spread >= 0.0 for r in pendulum.rows)


def test_what_diverges_and_what_does_not_converge_is_kept():
    builder = pbd.ModelBuilder()
    builder.add_particles([(0, 0, 0), (1, 0, 0)], mass=[0, 1])
    builder.add_distances([(0, 1)] * 3, rest_length=0.9)
    method = pbd.Jacobi(20, averaging="none")
    scene = pbd.Scene(builder, method=method, name="tripled", reference=lambda time: np.zeros((2, 3)))
    rows = sweep_scene(scene, OnlyItself(methods=("jacobi",), substeps=(1,), dtypes=("float32",), repeat=1)).rows
    assert [r.outcome for r in rows] == ["diverged"]
    assert np.isnan(rows[0].position_error)
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1, 0, 0], 12))
    outcomes = []
    # By its own word; by its stretch; neither.
    for method in (pbd.GaussSeidel(40, tolerance=1e-9), pbd.Jacobi(1), pbd.GaussSeidel(40)):
        scene = pbd.Scene(builder, method=method, name="slow")
        (row,) = sweep_scene(scene, OnlyItself(dtypes=("float32",), repeat=1)).rows
        outcomes.append((row.outcome, row.max_stretch > 0.1))
    assert outcomes == [("not converged", False), ("not converged", True), ("converged", False)]


class OnlyItself(Sweep):
    """The scene with the method that it has."""

    def configurations(self, scene):
        return [scene]


def test_scenes_without_a_reference_are_compared_with_themselves():
    sweep = Sweep(methods=("direct", "jacobi"), substeps=(2, 32), iterations=(4,), dtypes=("float64",), repeat=1)
    chart = sweep_scene(pbd.load_scene("rope"), sweep)
    assert chart.info["reference"] == "its own run with direct, 768 substeps (16 times its default), float64"
    # Damping is only for "pbd": the other integrators refuse, and are no rows.
    assert {r.integrator for r in chart.rows} == {"pbd"}
    error = {(r.method, r.substeps): r.position_error for r in chart.rows}
    assert error["direct", 32] < 0.2 * error["direct", 2]
    refused = Sweep(methods=("direct",), integrators=("midpoint",), repeat=1)
    with pytest.raises(pbd.InputError, match="in none of these configurations: integrator 'midpoint' does not model"):
        sweep_scene(pbd.load_scene("rope"), refused)


def test_chart_command(call, tmp_path):
    small = ["--substeps", "1,4", "--iterations", "5", "--errors", "1e-3", "--dtypes", "float64", "--repeat", "1"]
    code, out, err = call("chart", "oscillator", "--out", "o.svg", *small, "--pick", "1e-2", "--set", "mass=2.0")
    assert code == 0, err
    assert (tmp_path / "o.svg").read_text().startswith("<?xml")
    with open(tmp_path / "o.csv") as file:
        rows = [*csv.DictReader(line for line in file if not line.startswith("#"))]
    assert len(rows) == 3 * 4 * 2 + 2 + 1 + 2
    flags = out.splitlines()[-1].split()
    assert flags[0] == "--method"
    # What --pick prints is what `run` takes.
    code, out, err = call("run", "oscillator", "--frames", 3, *flags)
    assert code == 0, err
    first = (tmp_path / "o.svg").read_bytes()
    code, out, err = call("chart", "--from-csv", "o.csv", "--out", "again.svg")
    assert code == 0, err
    assert (tmp_path / "again.svg").read_bytes() == first


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["chart"], "needs a scene to measure or --from-csv"),
        (["chart", "rope", "--from-csv", "x.csv"], "and not both"),
        (["chart", "roap"], "did you mean 'rope'"),
        (["chart", "rope", "--out", "x.pdf"], "drawn as .svg or .png"),
        (["chart", "rope", "--out", "no/x.svg"], "no does not exist"),
        (["chart", "rope", "--methods", "jacoby"], "unknown method 'jacoby'"),
        (["chart", "rope", "--integrators", "pdb"], "unknown integrator 'pdb'"),
        (["chart", "rope", "--dtypes", "float16"], "unknown dtype 'float16'"),
        (["chart", "rope", "--substeps", "1,x"], "--substeps must be whole numbers separated by commas"),
        (["chart", "rope", "--iterations", "0"], "iterations must be at least 1"),
        (["chart", "rope", "--errors", "x"], "--errors must be numbers separated by commas"),
        (["chart", "rope", "--errors", "-1"], "errors must be a finite number above 0"),
        (["chart", "rope", "--repeat", "0"], "repeat must be at least 1"),
        (["chart", "rope", "--set", "links"], "write NAME=VALUE"),
        (["chart", "--from-csv", "no.csv"], "no.csv"),
        (["run", "rope", "--accuracy", "1e-9"], "no settings on the chart of scene rope are within 1e-09 m"),
        (["run", "rope", "--accuracy", "0.1", "--substeps", "3"], "--accuracy chooses method"),
        (["run", "rope", "--tolerance", "0"], "tolerance must be"),
    ],
)
def test_bad_usage(call, tmp_path, args, message):
    code, _, err = call(*args)
    assert code == 2
    assert message in " ".join(err.split())
    assert list(tmp_path.iterdir()) == []


def test_run_takes_its_settings_from_the_chart_that_comes_along(call):
    code, out, err = call("run", "chain", "--accuracy", "1e-3", "--frames", 61)
    assert code == 0, err
    assert re.match(r"--accuracy 0.001: --(method|integrator) .* on the chart\)", out)


STUDIED = {made.scene for made in MAPS.values()} | {"loop"} | {"knot", "pile", "links", "cable", "column", "groom"}
"""With a map, or a panel of one; the others by known answers: test_knots.py, test_touching.py, test_bending.py."""


def test_every_scene_comes_with_a_chart_or_a_map():
    charted = {path.stem for path in charts_folder().glob("*.csv")}
    assert charted | STUDIED == set(pbd.scene_names())


@pytest.mark.parametrize("name", sorted(path.stem for path in charts_folder().glob("*.csv")))
def test_charts_are_of_their_scene_and_those_that_are_shown(name):
    installed = charts_folder() / f"{name}.csv"
    assert {row.scene for row in load(installed).rows} == {name}
    assert (Path(__file__).parent.parent / "docs" / "charts" / f"{name}.svg").is_file()


def test_direct_is_measured_where_there_are_only_contacts():
    scene = pbd.load_scene("collision").changed(method=pbd.Direct())
    sim = pbd.Simulation(scene.builder, scene.settings)
    assert _projections(sim, 70) > 0.0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_device_is_no_chart(call):
    """It may never end."""
    code, _, err = call("chart", "--from-csv", "/dev/full")
    assert code == 2
    assert "cannot read the chart /dev/full: it is not an ordinary file" in err
