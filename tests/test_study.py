"""Studies: their grid, their rows, their file. What needs processes is in test_study_workers.py."""

import json
from contextlib import nullcontext

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.scene import scene_function
from pbd_warp.study.grid import make_grid, parse_values
from pbd_warp.study.measures import ARRAYS, names
from pbd_warp.study.store import load
from pbd_warp.study.study import make_runs, run_study
from pbd_warp.workers import ThisProcess

pytest.importorskip("pyarrow")


def rope(links: int = 4, mass: float = 1.0, tilt: float = 0.0, seed: int = 0, push: float = 0.0, drag: bool = False):
    """A rope from the horizontal, a little bent by chance."""
    builder = pbd.ModelBuilder()
    s = np.linspace(0.0, 1.0, links + 1)
    bent = np.random.default_rng(seed).normal(0.0, 0.01, links + 1)
    builder.add_rope(np.stack([s * np.cos(tilt), s * np.sin(tilt), bent], axis=1), mass=mass)
    if push:
        builder.add_particle((3.3e38, 0, 0), velocity=(push, 0, 0))  # not far from where float32 ends
    drags = [(0.0, "select", links), (0.1, "move", (1.0, 0.1, 0.0))] if drag else []
    return pbd.Scene(builder, frames=6, method=pbd.GaussSeidel(4), drag=drags)


def runs(grid, measures=("max_stretch", "energy"), scene=rope, seed=None, yes=False, **options):
    return make_runs(scene, grid, measures, seed, options, None, "float32", None, yes)


def rows_of(made, out=None, pool=ThisProcess):
    return run_study(made, out, lambda: nullcontext(pool()))


class Batches(ThisProcess):
    """Hands out all at once, as a worker gets them."""

    def run(self, function, items, tick):
        yield from enumerate(function(list(items)))


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("10,20, 50", ["10", "20", "50"]),
        ("0..3", ["0", "1", "2", "3"]),
        ("0:1:lin3", ["0", "0.5", "1"]),
        ("0.1:10:log3", ["0.1", "1", "10"]),
        ("jacobi,direct", ["jacobi", "direct"]),
        ("", []),
    ],
)
def test_values_of_an_axis(text, values):
    assert parse_values(text) == values


def test_a_grid_is_every_combination_the_last_axis_fastest():
    grid = make_grid("rope", rope, {"links": "2,3", "method": ["jacobi", "direct"], "mass": 0.5}, seed=range(2))
    assert len(grid) == 8
    assert [grid[k]["seed"] for k in range(4)] == [0, 1, 0, 1]
    assert grid[6] == {"links": 3, "method": "direct", "mass": 0.5, "seed": 0}
    assert make_grid("rope", rope, {"substeps": "2"})[0] == {"substeps": 2}
    assert make_grid("rope", rope, {"integrator": "dop853", "substeps": "auto"})[0]["substeps"] == "auto"


@pytest.mark.parametrize(
    ("grid", "options", "message"),
    [
        ({"lincs": "2"}, {}, "unknown parameter of scene rope, or setting, 'lincs'.*did you mean 'links'"),
        ({"links": "2.5"}, {}, "links .* must be like 4, not '2.5'"),
        ({"links": [2, 2.5]}, {}, "links .* must be like 4"),
        ({"iterations": "many"}, {}, "iterations must be a whole number, not 'many'"),
        ({"links": ""}, {}, "links has no values"),
        ({"links": "2,2"}, {}, "links has a value twice"),
        ({"mass": "1:2:cub3"}, {}, "must be like 0:1:lin11"),
        ({"mass": "0:2:log3"}, {}, "of numbers above 0"),
        ({"links": "1..b"}, {}, "two whole numbers, like 0..99"),
        ({"links": range(1, 1001), "mass": np.arange(1, 1001)}, {}, "1,000,000 combinations: say --yes"),
        ({}, {"measures": ["stretch"]}, "unknown measure 'stretch': there is .*max_stretch.*tension.max"),
        ({}, {"measures": ["tension"]}, "unknown measure 'tension'"),
        ({}, {"measures": []}, "nothing is measured: there is residual"),
        ({"links": "0"}, {}, "rope needs at least 2 particles"),
        ({}, {"measures": ["reaction.max"]}, "reaction is known with method 'direct', not with GaussSeidel"),
        ({}, {"measures": ["position_error"]}, "no reference, so there is no position_error"),
    ],
)
def test_bad_input_is_one_sentence(grid, options, message):
    with pytest.raises(pbd.InputError, match=message):
        runs(grid, **options)


def test_a_million_is_not_too_many_when_it_is_meant():
    assert len(runs({"links": range(1, 1001), "mass": np.arange(1, 1001)}, yes=True).grid) == 1_000_000


def test_a_seed_needs_something_random():
    with pytest.raises(pbd.InputError, match="nothing random"):
        make_grid("chain", scene_function("chain"), {}, seed=[0])


def test_rows_say_what_was_run_and_what_became_of_it():
    rows = rows_of(runs({"links": "2,4", "push": [0.0, 1e39]}, damping=0.1))
    assert [rows[k]["outcome"] for k in range(4)] == ["finished", "refused", "finished", "refused"]
    assert "too large or fast" in rows[1]["sentence"]
    row = rows[2]
    assert (row["row"], row["links"], row["method"], row["iterations"], row["damping"], row["frames"]) == (
        *(2, 4, "gauss-seidel", 4, 0.1, 6),
    )
    scene = rope(4)
    sim = pbd.Simulation(scene.builder, scene.settings, damping=0.1)
    for _ in range(5):
        sim.step()
    assert row["max_stretch"] == pbd.measure(sim).max_stretch > 0.0
    assert row["energy"] == pbd.measure(sim).energy
    assert row["wall_s"] > 0.0
    assert row["machine"]


def test_which_rows_are_made_together_changes_no_bit():
    grid = {"links": "3,4", "mass": "0.5,2", "tilt": "0,0.3", "method": "jacobi,gauss-seidel,direct"}
    made = runs(grid, ["max_stretch", "energy", "tip", "momentum.y"], seed=[1, 2])
    alone, together = rows_of(made), rows_of(made, pool=Batches)
    assert {row["together"] for row in alone.values()} == {1}
    assert {row["together"] for row in together.values()} == {8}
    for number, row in alone.items():
        for name in row.keys() - {"wall_s", "together"}:
            assert row[name] == together[number][name], name
    assert len({row["energy"] for row in alone.values()}) == len(alone)


@pytest.mark.parametrize(
    "settings", [{"tolerance": 1e-3, "iterations": 200}, {"on_failure": "subdivide"}, {"integrator": "dop853"}]
)
def test_where_something_decides_for_all_runs_are_made_one_by_one(settings):
    made = runs({"mass": [1.0], "tilt": [0.0, 0.3, 1.2]}, ["energy", "tip"], seed=[1, 2], **settings)
    alone, together = rows_of(made), rows_of(made, pool=Batches)
    assert [row["outcome"] for row in alone.values()] == ["finished"] * 6, alone
    for number, row in alone.items():
        assert row | {"wall_s": 0.0} == together[number] | {"wall_s": 0.0}


@pytest.mark.parametrize("grid", [{"push": [1.0, 3e38, 2.0]}, {"tilt": [0.0, 0.1], "tolerance": 1e-6}])
def test_failures_are_rows_with_the_sentence_they_have_alone(grid):
    made = runs(grid, iterations=8)
    alone, together = rows_of(made), rows_of(made, pool=Batches)
    for number in alone:
        assert (alone[number]["outcome"], alone[number]["sentence"]) == (
            *(together[number]["outcome"], together[number]["sentence"]),
        )
    if "push" in grid:
        assert [row["outcome"] for row in together.values()] == ["finished", "failed", "finished"], together
        assert "particle 5 has left the finite numbers" in together[1]["sentence"]
        assert "energy" not in together[1] or np.isnan(together[1]["energy"])


def test_a_drag_moves_each_run():
    together = rows_of(runs({"drag": [True], "tilt": [0.0, 0.1]}, ["tip"]), pool=Batches)
    assert {row["together"] for row in together.values()} == {1}
    assert all(abs(row["tip.y"] - 0.1) < 0.11 for row in together.values())


def test_every_measure_by_name_measures():
    every = [name for name in names() if name.split(".")[0] not in ARRAYS]
    row = rows_of(make_runs("chain", {}, every, None, {}, 4, "float64", None, False))[0]
    assert row["outcome"] == "finished", row["sentence"]
    assert row["position_error"] < 1e-4
    assert 0.9 < np.hypot(row["tip.x"], row["tip.y"]) < 1.0
    forces = ["tension.max", "tension.min", "tension.mean", "reaction.max"]
    row = rows_of(runs({"method": "direct"}, forces))[0]
    assert row["tension.max"] >= row["tension.mean"] >= row["tension.min"]
    row = rows_of(runs({"method": "direct,jacobi"}, forces))[1]
    assert (row["outcome"], "tension is known with method 'direct'" in row["sentence"]) == ("refused", True)


def test_measures_of_ones_own():
    def height(sim):
        return sim.positions[:, 1].min()

    def ends(sim):
        return sim.positions[[0, -1], 0]

    def wrong(sim):
        return 1 / 0

    rows = rows_of(runs({"tilt": [0.0, 0.5]}, [height, ends, "energy"]), pool=Batches)
    assert rows[0]["height"] < 0.0
    assert rows[0]["ends.0"] == 0.0 < rows[0]["ends.1"]
    row = rows_of(runs({}, [wrong]))[0]
    assert (row["outcome"], "measure wrong failed: ZeroDivisionError" in row["sentence"]) == ("refused", True)


def test_whatever_goes_wrong_in_a_row_ends_no_other():
    def wrong(tilt: float = 0.0):
        return rope(tilt=tilt).changed(reference=lambda t: 1 / tilt * np.zeros((5, 3)))

    made = runs({"tilt": [0.1, 0.0, 0.2]}, ["position_error"], wrong)
    for pool in (ThisProcess, Batches):
        rows = rows_of(made, pool=pool)
        assert [row["outcome"] for row in rows.values()] == ["finished", "failed", "finished"]
        assert rows[1]["sentence"] == "ZeroDivisionError: float division by zero"


class Stops(ThisProcess):
    """Makes some rows, and then somebody presses Ctrl-C."""

    def run(self, function, items, tick):
        for number, row in super().run(function, items, tick):
            if number == 3:
                raise KeyboardInterrupt
            yield number, row


def test_a_stopped_study_leaves_a_whole_file_and_goes_on(tmp_path):
    made, out = runs({"mass": "1:10:log6"}), tmp_path / "s.parquet"
    with pytest.raises(pbd.PbdError, match=r"interrupted.*goes on.*3 of 6 rows are in"):
        rows_of(made, out, Stops)
    assert [p.name for p in tmp_path.iterdir()] == ["s.parquet"]
    assert load(out)["row"].to_list() == [0, 1, 2]
    asked = []

    class Counts(ThisProcess):
        def run(self, function, items, tick):
            asked.extend(items)
            return super().run(function, items, tick)

    rows_of(made, out, Counts)
    assert asked == [3, 4, 5]
    frame = load(out)
    assert frame["row"].to_list() == list(range(6))
    whole = rows_of(made)
    assert frame["energy"].to_list() == [whole[k]["energy"] for k in range(6)]


def test_what_a_kill_leaves_is_gone_on_from(tmp_path):
    """The journal of a killed study: its lines, and a part of one."""
    made, out = runs({"mass": "1:10:log6"}), tmp_path / "s.parquet"
    rows = rows_of(made)
    from pbd_warp.study.store import Store
    from pbd_warp.study.study import _identity

    store = Store(out, _identity(made))
    store.add([rows[4], rows[1]])
    with pytest.raises(pbd.InputError, match="another study is writing"):
        Store(out, _identity(made))
    store._journal.write(json.dumps(rows[2]).encode()[:-20])
    store._journal.close()
    again = Store(out, _identity(made))
    assert sorted(again.rows) == [1, 4]
    again.add([rows[0]])
    again._journal.close()  # killed once more
    again = Store(out, _identity(made))
    assert sorted(again.rows) == [0, 1, 4]
    again.close()
    assert sorted(load(out)["row"]) == [0, 1, 4]


@pytest.mark.parametrize("other", [{"mass": "1,2,3"}, {"mass": "1,2", "tilt": "0"}])
def test_the_file_of_another_study_is_refused(tmp_path, other):
    out = tmp_path / "s.parquet"
    rows_of(runs({"mass": "1,2"}), out)
    with pytest.raises(pbd.InputError, match="is of another study: its grid is"):
        rows_of(runs(other), out)
    with pytest.raises(pbd.InputError, match="its measures is"):
        rows_of(runs({"mass": "1,2"}, ["tip"]), out)
    out.write_bytes(b"no table")
    with pytest.raises(pbd.InputError, match="is no study"):
        rows_of(runs({"mass": "1,2"}), out)
    with pytest.raises(pbd.InputError, match=r"written as \.parquet"):
        rows_of(runs({"mass": "1,2"}), tmp_path / "s.csv")
