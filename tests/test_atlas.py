"""The atlas: what counts as a failure, where theory has the boundaries, and that what is shown is what was measured."""

import dataclasses
import os
import signal
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.preflight import REMEDIES
from pbd_warp.stability import theory
from pbd_warp.stability.atlas import COLUMNS, Measured, load, measure_cell, measure_map, save
from pbd_warp.stability.cell import study
from pbd_warp.stability.classify import GAINED, LEFT, OFF, OUTCOMES, Figures, classify
from pbd_warp.stability.draw import LOOKS, boundary_line, draw
from pbd_warp.stability.map import Axis, Boundary, Map, Panel
from pbd_warp.stability.maps import MAPS, choose
from pbd_warp.stability.page import page
from pbd_warp.step.divergence import STRETCHED

SHOWN = Path(__file__).parent.parent / "docs" / "stability"
WITH_THEORY = [
    pytest.param(name, panel, id=f"{name}: {panel}")
    for name, made in MAPS.items()
    for panel, settings in made.panels.items()
    if settings.boundary
]
every_map = pytest.mark.parametrize("name", MAPS)


# What counts as a failure.


@pytest.mark.parametrize(
    ("figures", "outcome"),
    [
        ({}, "converged"),
        ({"error": OFF}, "converged"),
        ({"error": 1.01 * OFF}, "off"),
        ({"left": LEFT}, "converged"),
        ({"left": 1.01 * LEFT, "error": 1.0}, "not converged"),
        ({"stretch": STRETCHED}, "converged"),
        ({"stretch": 1.01 * STRETCHED, "left": 1.0}, "stretched"),
        ({"energy_gain": GAINED}, "converged"),
        ({"energy_gain": -5.0}, "converged"),
        ({"energy_gain": 1.01 * GAINED, "stretch": 1.0}, "gained energy"),
        ({"missed": True, "energy_gain": 1.0}, "missed"),
        ({"finite": False, "missed": True, "stretch": float("inf")}, "not finite"),
    ],
)
def test_thresholds_and_their_precedence(figures, outcome):
    assert classify(Figures(**figures)) == outcome
    assert outcome in OUTCOMES
    order = list(OUTCOMES)
    assert order.index("not finite") < order.index("missed") < order.index("gained energy") < order.index("stretched")


# The maps.


def test_the_maps_are_those_promised_and_each_has_a_scene():
    names = "relaxation star overconstrained mass_ratio chain_length chebyshev step precision speed overlap unreachable"
    assert set(MAPS) >= {*names.split(), "cradle", "coincident"}
    for name, made in MAPS.items():
        assert made.name == name
        assert made.scene in pbd.scene_names()
        assert made.title
        assert made.text.endswith(".")
        assert made.remedy == made.remedy.strip(". ")
        for axis in (made.x, made.y):
            assert list(axis.values) == sorted(set(axis.values))
        assert made.size == len(made.panels) * len(made.x.values) * len(made.y.values)


def test_maps_are_chosen_by_name_and_by_scene():
    assert choose([]) == list(MAPS.values())
    assert [made.name for made in choose(["step", "star"])] == ["star", "step"]
    assert {made.name for made in choose(["chain"])} == {"relaxation", "sweeps"}
    with pytest.raises(pbd.InputError, match=r"unknown map or scene 'stap': .*did you mean 'step'"):
        choose(["stap"])


@pytest.mark.parametrize("axis", [Axis("a", (1, 2, 4, 8), log=True), Axis("b", (0.5, 1.0, 1.5))])
def test_places_on_an_axis_are_counted_in_cells(axis):
    assert [axis.place(value) for value in axis.values] == pytest.approx(range(len(axis.values)))
    assert axis.value(axis.place(1.3)) == pytest.approx(1.3)
    first, last = axis.values[0], axis.values[-1]
    beyond = (first**2 / axis.values[1], last**2 / axis.values[-2]) if axis.log else (0.0, 2.0)
    assert [axis.place(value) for value in beyond] == pytest.approx([-1.0, len(axis.values)])


# Theory, against matrices and loops of its own.


def largest_eigenvalue(model):
    """Of D^-1 A for the plain sum, with A = J W J^T written out edge by edge."""
    edge = model.distance.edge
    d = model.x[edge[:, 0]] - model.x[edge[:, 1]]
    jacobian = np.zeros((len(edge), model.particle_count, 3))
    for k, ((i, j), n) in enumerate(zip(edge, d / np.linalg.norm(d, axis=1, keepdims=True), strict=True)):
        jacobian[k, i], jacobian[k, j] = n, -n
    a = np.einsum("kpc,p,lpc->kl", jacobian, model.w, jacobian)
    return np.linalg.eigvals(a / np.diag(a)[:, None]).real.max()


def in_the_middle(model):
    """The star's hub starts a little off, which the linear theory leaves out."""
    model.x[0] = 0.0
    return model


@pytest.mark.parametrize("n", [1, 2, 3, 7, 20])
def test_limits_of_relaxation_are_eigenvalues(n):
    chain = pbd.ModelBuilder()
    chain.add_rope(np.linspace([0.0, 0, 0], [1, 0, 0], n + 1), mass=[1.0] * (n + 1), pinned=())
    found = {theory.chain_limit(n): chain.finalize("cpu")}
    for sides, limit in ((1, theory.bar_limit(n)), (3, theory.triangle_limit(n))):
        found[limit] = study("overconstrained", copies=n, sides=sides, misfit=0.0).builder.finalize("cpu")
    for shape in theory.DIRECTIONS if n > 2 else ("line",):
        model = in_the_middle(study("star", spokes=n, shape=shape).builder.finalize("cpu"))
        found[theory.star_limit(n, shape)] = model
    for limit, model in found.items():
        assert limit * largest_eigenvalue(model) == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize("sweeps", range(1, 9))
def test_limit_of_sweeps_is_where_the_recurrence_turns_unstable(sweeps):
    """e_n+1 = g (2 e_n - e_n-1) with g = (1 - r)^sweeps."""

    def grows(relaxation):
        g = (1.0 - relaxation) ** sweeps
        return np.abs(np.linalg.eigvals([[2.0 * g, -g], [1.0, 0.0]])).max() > 1.0

    limit = theory.sweeps_limit(sweeps)
    assert not grows(limit - 1e-3)
    assert grows(limit + 1e-3)


@pytest.mark.parametrize("method", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("sweeps", [1, 3])
def test_sag_is_where_a_hanging_chain_comes_to_rest(method, sweeps):
    """Heights as a loop: fall, sweeps, and velocities forgotten, until nothing moves."""
    w, step, rest = theory.heavy_bob(4.0, 6), 1.0 / 120.0, 1.0 / 6.0
    share = np.r_[1, 2, 2, 2, 2, 2, 1] * w if method == "jacobi" else w
    y = -rest * np.arange(7.0)
    for _ in range(4000):
        y[1:] -= step**2 * theory.GRAVITY
        for _ in range(sweeps):
            groups = [range(6)] if method == "jacobi" else [range(0, 6, 2), range(1, 6, 2)]
            for group in groups:
                push = np.zeros(7)
                for k in group:
                    lam = (y[k] - y[k + 1] - rest) / (share[k] + share[k + 1])
                    push[k] -= w[k] * lam
                    push[k + 1] += w[k + 1] * lam
                y += push
    stretch = (-np.diff(y) / rest - 1.0).max()
    assert theory.sag(w, sweeps, step, method) == pytest.approx(stretch, rel=1e-9)
    assert stretch > 0.01


def test_sweeps_for_a_stretch_leave_just_that():
    w = theory.rope_masses(30)
    needed = theory.sweeps_for(w, 1.0 / 60.0, "jacobi")
    around = [theory.sag(w, int(k), 1.0 / 60.0, "jacobi") for k in (np.floor(needed), np.ceil(needed))]
    assert around[0] > STRETCHED > around[1]


# What was measured is where theory has it: the committed maps, and cells measured now.


@pytest.fixture(scope="module")
def atlas():
    return {name: load(made, SHOWN / f"{name}.csv") for name, made in MAPS.items()}


@pytest.mark.parametrize(("name", "panel"), WITH_THEORY)
def test_the_committed_boundary_is_within_one_cell_of_theory(atlas, name, panel):
    measured = atlas[name]
    assert measured.beside_theory(panel) == []
    boundary = measured.map.panels[panel].boundary
    outcomes = {cell.outcome in boundary.outcomes for cell in measured.panel(panel).values()}
    assert outcomes == {True, False}, "the boundary is not on the map"
    # A boundary four cells off would be found out, on the side where there are cells.
    axis = measured.map.y if boundary.along == "x" else measured.map.x
    assert any(shifted(measured, panel, axis, cells).beside_theory(panel) for cells in (-4.0, 4.0))


def shifted(measured, name, axis, cells):
    """The same cells with theory's boundary moved by some cells."""
    boundary = measured.map.panels[name].boundary
    panel = replace(
        measured.map.panels[name],
        boundary=replace(boundary, of=lambda value: axis.value(axis.place(boundary.of(value)) + cells)),
    )
    return replace(measured, map=replace(measured.map, panels={name: panel}))


@pytest.mark.parametrize(("name", "panel"), WITH_THEORY)
def test_cells_next_to_the_boundary_measured_now(name, panel):
    """On each side the two nearest of those that are more than one cell away."""
    made = MAPS[name]
    off = {(x, y): made.distance(panel, x, y) for x in made.x.values for y in made.y.values}
    for side in (-1.0, 1.0):
        near = sorted((cell for cell in off if side * off[cell] > 1.0), key=lambda cell: abs(off[cell]))[:2]
        assert near, "the boundary is at the edge of the map"
        for x, y in near:
            fails = measure_cell(made, panel, x, y).outcome in made.panels[panel].boundary.outcomes
            assert fails == (side > 0.0), (x, y)


# Files.


@every_map
def test_what_is_shown_is_what_was_measured(atlas, name, tmp_path):
    measured = atlas[name]
    assert {"machine", "versions", "date"} <= set(measured.info)
    save(measured, tmp_path / "again.csv")
    assert (tmp_path / "again.csv").read_bytes() == (SHOWN / f"{name}.csv").read_bytes()
    svg = SHOWN / f"{name}.svg"
    assert svg.stat().st_size < 150_000
    shown = {group.get("id") for group in ElementTree.parse(svg).getroot().iter() if group.get("id")}
    for cell in measured.cells:
        assert f"{cell.outcome}-{cell.panel}".replace(" ", "-") in shown


def test_the_page_shows_all_maps(atlas):
    text = (SHOWN / "README.md").read_text()
    assert text == page(list(atlas.values()))
    for name, made in MAPS.items():
        assert f"({name}.svg)" in text
        assert made.remedy in text
    assert "on the wrong side of theory by more than one cell." in text


SMALL = Map(
    name="small",
    title="Small",
    scene="star",
    x=Axis("x", (1.0, 2.0, 4.0), log=True),
    y=Axis("y", (1.0, 2.0)),
    panels={
        "all": Panel(
            lambda x, y: Figures(stretch=0.05 * x, error=0.02 if y > 1.0 else 0.0),
            Boundary(lambda x: 1.0 + x / 4.0, "b"),
        ),
        "some": Panel(lambda x, y: Figures(finite=pbd.Jacobi(relaxation=y) is None)),
    },
    text="Text.",
)


@pytest.fixture(autouse=True)
def remedy(monkeypatch):
    monkeypatch.setitem(REMEDIES, "small", "remedy")


def test_every_cell_is_measured_and_comes_back(tmp_path):
    calls = []
    measured = measure_map(SMALL, lambda: calls.append(1))
    assert len(measured.cells) == len(calls) == SMALL.size == 12
    found = {(cell.panel, cell.x, cell.y): cell.outcome for cell in measured.cells}
    assert found["all", 1.0, 1.0] == "converged"
    assert found["all", 1.0, 2.0] == "off"
    assert found["all", 4.0, 2.0] == "stretched"
    assert found["some", 1.0, 1.0] == "not finite"
    assert found["some", 1.0, 2.0] == "refused"
    save(measured, tmp_path / "small.csv")
    assert load(SMALL, tmp_path / "small.csv") == measured
    header = (tmp_path / "small.csv").read_text().splitlines()[len(measured.info)]
    assert header == ",".join(COLUMNS)


def test_cells_of_another_map_are_refused(tmp_path):
    measured = measure_map(SMALL)
    fewer = replace(measured, cells=measured.cells[1:])
    save(fewer, tmp_path / "small.csv")
    with pytest.raises(pbd.InputError, match=r"small\.csv: its cells are not those of the map small"):
        load(SMALL, tmp_path / "small.csv")
    (tmp_path / "small.csv").write_text(",".join(COLUMNS) + "\nall,1,1,fine,0,0,0,0,0\n")
    with pytest.raises(pbd.InputError, match="line 2: unknown outcome 'fine': there is refused"):
        load(SMALL, tmp_path / "small.csv")


def test_a_run_that_stops_by_itself_did_not_converge(monkeypatch):
    """Whatever limits a simulation sets itself: no cell is dropped, and none that stopped counts as good."""
    from pbd_warp.stability.cell import run_scene

    def stop(sim):
        raise pbd.SimulationFailed("enough")

    monkeypatch.setattr(pbd.Simulation, "step", stop)
    assert classify(run_scene(study("long_rope", links=3))) == "not converged"


# The picture.


def test_all_outcomes_look_different_without_colour_too():
    assert LOOKS.keys() == OUTCOMES.keys()
    assert len({colour for colour, _ in LOOKS.values()}) == len(LOOKS)

    def grey(colour):
        return sum(int(colour[k : k + 2], 16) for k in (1, 3, 5)) / 3 // 64

    assert len({(hatch, grey(colour)) for colour, hatch in LOOKS.values()}) == len(LOOKS)


def test_the_same_cells_give_the_same_bytes(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    measured = measure_map(SMALL)
    draw(measured, tmp_path / "a.svg")
    with matplotlib.rc_context({"font.size": 30.0, "svg.fonttype": "path"}):
        draw(measured, tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    draw(measured, tmp_path / "c.png")
    assert (tmp_path / "c.png").read_bytes().startswith(b"\x89PNG")
    other = replace(measured, cells=tuple(dataclasses.replace(c, outcome="missed") for c in measured.cells))
    draw(other, tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_bytes() != (tmp_path / "b.svg").read_bytes()


def test_the_boundary_is_drawn_where_it_is():
    line = boundary_line(SMALL, SMALL.panels["all"].boundary)
    # y = 1 + x/4 at x = 1, 2, 4 is 0.25, 0.5 and 1 cells up.
    for x, y in ((0.0, 0.25), (1.0, 0.5), (2.0, 1.0)):
        assert line[np.argmin(np.abs(line[:, 0] - x)), 1] == pytest.approx(y)
    upright = Boundary(lambda y: 2.0, "2", along="y")
    np.testing.assert_allclose(boundary_line(SMALL, upright)[:, 0], 1.0)
    assert Measured(SMALL, (), {}).beside_theory("some") == []


# The command.


@pytest.fixture
def call(call, monkeypatch):
    """The command `stability`, which also knows a small map."""
    monkeypatch.setitem(MAPS, "small", SMALL)
    return lambda *args: call("stability", *args, "--workers", "1")


def test_command(call, tmp_path):
    code, out, err = call("small", "--out", "maps")
    assert (code, err) == (0, "")
    assert out == "1 maps, 12 cells: maps/README.md\n"
    assert {path.name for path in (tmp_path / "maps").iterdir()} == {"small.csv", "small.svg", "README.md"}
    assert "![Small](small.svg)" in (tmp_path / "maps" / "README.md").read_text()


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["stap"], "unknown map or scene 'stap'"),
        (["small", "--out", "no/such"], "the output folder no does not exist"),
        (["small", "--out", "file"], "the output folder file does not exist"),
    ],
)
def test_bad_usage(call, tmp_path, args, message):
    (tmp_path / "file").write_text("x")
    code, _, err = call(*args)
    assert code == 2
    assert message in err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("library", ["matplotlib", "pbd_warp.accuracy.references"])
def test_what_the_maps_need_is_named_before_anything_is_made(call, tmp_path, monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    code, _, err = call("small", "--out", "maps")
    assert code == 2
    assert "pip install 'pbd-warp[chart]'" in err
    assert not list(tmp_path.iterdir())


def test_ctrl_c_keeps_the_maps_that_are_done(call, tmp_path, monkeypatch):
    def interrupted(x, y):
        os.kill(os.getpid(), signal.SIGINT)
        return Figures()

    monkeypatch.setitem(MAPS, "late", replace(SMALL, name="late", panels={"only": Panel(interrupted)}))
    code, out, err = call("small", "late", "--out", "maps")
    assert code == 130
    assert out == ""
    assert err == "pbd-warp: interrupted after 1 of 2 maps; small in maps\n"
    assert {path.name for path in (tmp_path / "maps").iterdir()} == {"small.csv", "small.svg"}
