"""The chart's data, front and picture. No test measures anything or needs a display."""

import dataclasses
import itertools
import math
import re
import sys
import xml.etree.ElementTree as ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pbd_warp.accuracy.chart import COLUMNS, OUTCOMES, Chart, Row, flags, front, load, pick, save
from pbd_warp.accuracy.plot import draw
from pbd_warp.errors import InputError

INFO = {"machine": "a, b: 2 cores", "versions": "warp 1.16", "date": "2025-07-01", "reference": "RK4 at h = 1e-5."}
ROW = Row(
    "chain", "direct", "midpoint4", "float64", 2, 20, 0.0, 0.1 + 0.2, 0.05, 1200.0, 4e-6, 1e-12, -1e-9, "converged"
)
SVG = "{http://www.w3.org/2000/svg}"


def row(error=1e-3, wall=1.0, **changes):
    return dataclasses.replace(ROW, position_error=error, wall_ms_per_sim_second=wall, **changes)


def varied():
    """Rows of every outcome, with costs and errors over several decades, and a zero error."""
    rows = [
        row(
            0.3 / substeps**order * (1.0 + 10.0 / iterations**2),
            substeps * iterations * 0.1,
            method=method,
            integrator=integrator,
            dtype=dtype,
            substeps=substeps,
            iterations=iterations,
            projections_per_sim_second=60.0 * substeps * iterations,
            outcome="converged" if iterations > 2 else "not converged",
        )
        for method, iterations in (("jacobi", 2), ("gauss-seidel", 8), ("direct", 4), ("of-my-own", 3))
        for integrator, order in (("pbd", 1), ("midpoint", 2))
        for dtype in ("float32", "float64")
        for substeps in (1, 4, 16, 64)
    ]
    failed = [row(error, 2.0, outcome="diverged") for error in (math.nan, math.inf, 1e9)]
    return Chart((*rows, row(0.0, 500.0), *failed, row(math.nan, 3.0)), INFO)


numbers = st.floats()
texts = st.text(st.characters(codec="utf-8", exclude_characters="\r\n"), max_size=8)
any_rows = st.builds(
    Row,
    *[texts] * 4,
    *[st.integers()] * 2,
    *[numbers] * 7,
    st.sampled_from(OUTCOMES),
)


# The file


def test_columns_are_those_promised():
    assert ",".join(COLUMNS) == (
        "scene,method,integrator,dtype,substeps,iterations,error,wall_ms_per_sim_second,wall_spread,"
        "projections_per_sim_second,position_error,max_stretch,energy_drift,outcome"
    )


@given(rows=st.lists(any_rows, min_size=1, max_size=4))
def test_what_is_saved_is_loaded(tmp_path_factory, rows):
    path = tmp_path_factory.mktemp("chart") / "chart.csv"
    chart = Chart(tuple(rows), INFO)
    save(chart, path)
    assert load(path) == chart


def test_not_a_number_and_infinity_survive(tmp_path):
    chart = Chart(
        (row(float("nan")), row(math.inf, outcome="diverged"), row(-math.inf)), {"note": " # odd: ", "empty": ""}
    )
    save(chart, tmp_path / "chart.csv")
    loaded = load(tmp_path / "chart.csv")
    assert loaded == chart
    assert set(loaded.rows) == set(chart.rows)
    assert math.isnan(loaded.rows[0].position_error)
    assert "# note:  # odd: \n" in (tmp_path / "chart.csv").read_text()


@pytest.mark.parametrize("name", ["two\nlines", "two\rlines"])
def test_names_that_would_not_come_back_are_refused(tmp_path, name):
    with pytest.raises(InputError, match="must fit one line"):
        save(Chart((row(scene=name),), INFO), tmp_path / "chart.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("info", [{"a:b": "c"}, {" a": "c"}, {"a": "two\nlines"}, {"a\r": "c"}])
def test_info_that_would_not_come_back_is_refused(tmp_path, info):
    with pytest.raises(InputError, match="must fit one line"):
        save(Chart((ROW,), info), tmp_path / "chart.csv")
    assert not list(tmp_path.iterdir())


HEADER = ",".join(COLUMNS)
LINE = ",".join(ROW.cells())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: the columns must be .*, but there is no scene, method"),
        (f"# a: b\n{HEADER.replace('dtype,', '')}\n{LINE}\n", "line 2: the columns must be .*, but there is no dtype$"),
        (f"{HEADER},more\n{LINE},1\n", "line 1: the columns must be .*, but they are .*,? more$"),
        (f"# a: b\n{HEADER}\n", "there are no rows under the columns"),
        (f"# a: b\n{HEADER}\n{LINE}\n\n{LINE},5\n", "line 5: there are 15 values for 14 columns"),
        (f"# a: b\n{HEADER}\n{LINE}\nx\n", "line 4: there are 1 values for 14 columns"),
        (f"{HEADER}\n{LINE.replace(',2,20,', ',2,1.5,')}\n", "line 2: iterations must be a whole number, not '1.5'"),
        (f"{HEADER}\n{LINE.replace('1200.0', 'many')}\n", "projections_per_sim_second must be a number, not 'many'"),
        (
            f"{HEADER}\n{LINE.replace('converged', 'convergd')}\n",
            "line 2: unknown outcome 'convergd': .*mean 'converged'",
        ),
        (f"# a\n{HEADER}\n{LINE}\n", "line 1: must be '# key: value'"),
        (f"# a: 1\n# a: 2\n{HEADER}\n{LINE}\n", "line 2: must be '# key: value', with each key once"),
    ],
)
def test_a_bad_file_is_one_clear_sentence(tmp_path, text, message):
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith(f"{path}")
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    for name, reason in (("none.csv", "No such file"), ("", "Is a directory"), ("binary.csv", "not text in UTF-8")):
        with pytest.raises(InputError, match=f"cannot read the chart {tmp_path / name}: .*{reason}"):
            load(tmp_path / name)


# What is chosen from it

few = st.sampled_from([0.0, 1e-6, 1e-3, 0.5, 1.0, math.inf, math.nan])
few_rows = st.lists(st.builds(row, few, few, outcome=st.sampled_from(OUTCOMES)), max_size=12)


@given(rows=few_rows)
def test_front_is_what_no_other_row_beats(rows):
    able = [r for r in rows if r.outcome != "diverged" and math.isfinite(r.position_error + r.wall_ms_per_sim_second)]
    places = {(r.wall_ms_per_sim_second, r.position_error) for r in able}
    unbeaten = [p for p in places if not any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in places)]
    best = front(rows)
    assert [(r.wall_ms_per_sim_second, r.position_error) for r in best] == sorted(unbeaten)
    assert all(r in able for r in best)
    assert all(a.position_error > b.position_error for a, b in itertools.pairwise(best))


@given(rows=few_rows, error=st.sampled_from([0.0, 1e-4, 0.5, 2.0, math.inf]))
def test_pick_is_the_cheapest_that_is_good_enough(rows, error):
    picked = pick(rows, error)
    good = [
        r.wall_ms_per_sim_second
        for r in rows
        if r.outcome != "diverged" and r.position_error <= error and math.isfinite(r.position_error)
        if math.isfinite(r.wall_ms_per_sim_second)
    ]
    if not good:
        assert picked is None
    else:
        assert picked.position_error <= error
        assert picked.outcome != "diverged"
        assert picked.wall_ms_per_sim_second == min(good)


def test_front_goes_by_the_cost_asked_for():
    slow = row(1e-3, 9.0, projections_per_sim_second=1.0)
    fast = row(1e-3, 1.0, projections_per_sim_second=9.0)
    assert front([slow, fast]) == [fast]
    assert front([slow, fast], "projections_per_sim_second") == [slow]


def test_flags_are_those_of_run():
    assert flags(ROW) == "--method direct --integrator midpoint4 --substeps 2 --iterations 20 --dtype float64"
    explicit = dataclasses.replace(ROW, method="none", integrator="dop853", iterations=0)
    assert flags(explicit) == "--integrator dop853 --substeps 2 --dtype float64"
    auto = dataclasses.replace(explicit, error=1e-6)
    assert flags(auto) == "--integrator dop853 --substeps auto --error 1e-06 --dtype float64"
    for row, label in (
        (ROW, "2"),
        (dataclasses.replace(ROW, method="jacobi"), "2\N{MULTIPLICATION SIGN}20"),
        (auto, "1e-06 m/s"),
    ):
        assert row.label == label


# The picture


def svg(chart, path):
    draw(chart, path)
    return ElementTree.parse(path).getroot()


def marks(root, prefix):
    """Markers of all groups whose id begins so."""
    groups = [group for group in root.iter(f"{SVG}g") if group.get("id", "").startswith(prefix)]
    return sum(len(list(group.iter(f"{SVG}use"))) for group in groups)


def test_every_row_is_drawn_in_both_panels(tmp_path):
    pytest.importorskip("matplotlib")
    root = svg(varied(), tmp_path / "chart.svg")
    ids = [element.get("id") for element in root.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    for panel in ("wall", "projections"):
        assert marks(root, f"{panel}-converged") == 49
        assert marks(root, f"{panel}-not-converged") == 16
        assert marks(root, f"{panel}-diverged") == 4
        assert {f"{panel}-{name}" for name in ("front", "floor", "slope-1", "slope-2", "slope-4")} <= set(ids)
    text = "\n".join("".join(element.itertext()) for element in root.iter(f"{SVG}text"))
    for wanted in ("chain", "of-my-own", "float32 floor", "no error", "a, b: 2 cores; warp 1.16; 2025-07-01", "RK4"):
        assert wanted in text


def test_crosses_lie_above_and_zero_errors_below_all_else(tmp_path):
    pytest.importorskip("matplotlib")
    root = svg(Chart((row(1e-3), row(0.0, method="zero"), row(1e9, outcome="diverged")), INFO), tmp_path / "chart.svg")
    ys = {}
    for group in root.iter(f"{SVG}g"):
        for name in ("wall-diverged", "wall-converged-direct", "wall-converged-zero"):
            if group.get("id", "").startswith(name):
                ys[name] = float(next(group.iter(f"{SVG}use")).get("y"))
    assert ys["wall-diverged"] < ys["wall-converged-direct"] < ys["wall-converged-zero"]


def test_the_same_chart_gives_the_same_bytes(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    draw(varied(), tmp_path / "a.svg")
    with matplotlib.rc_context({"font.size": 30.0, "svg.fonttype": "path"}):
        draw(varied(), tmp_path / "b.svg")
        assert matplotlib.rcParams["font.size"] == 30.0
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert (tmp_path / "a.svg").stat().st_size < 150_000
    assert not re.search("<dc:date>", (tmp_path / "a.svg").read_text())


@pytest.mark.parametrize(
    ("rows", "crosses"),
    [
        ((row(),), 0),
        ((row(math.nan, outcome="diverged"), row(math.inf, 4.0, outcome="diverged")), 2),
        ((row(0.0, wall_spread=math.nan, projections_per_sim_second=0.0),), 0),
        ((row(1e-3, math.nan), row(1e-5, 3.0, wall_spread=5.0, dtype="float32")), 0),
    ],
    ids=["one", "only diverged", "only zero", "cost unknown"],
)
def test_poor_charts_are_drawn_whole(tmp_path, rows, crosses):
    pytest.importorskip("matplotlib")
    root = svg(Chart(rows, {}), tmp_path / "chart.svg")
    assert marks(root, "wall-diverged") == marks(root, "projections-diverged") == crosses
    assert marks(root, "wall-converged") == marks(root, "projections-converged") == len(rows) - crosses


def test_png(tmp_path):
    pytest.importorskip("matplotlib")
    draw(Chart((ROW,), INFO), tmp_path / "chart.PNG")
    assert (tmp_path / "chart.PNG").read_bytes().startswith(b"\x89PNG")
    assert "matplotlib.pyplot" not in sys.modules


def test_another_suffix_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"drawn as \.svg or \.png, not .*chart\.pdf"):
        draw(Chart((ROW,), INFO), tmp_path / "chart.pdf")


def test_without_matplotlib_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError) as caught:
        draw(Chart((ROW,), INFO), tmp_path / "chart.svg")
    assert str(caught.value) == "drawing a chart needs matplotlib: pip install 'pbd-warp[chart]'"
