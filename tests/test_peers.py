"""Other simulators on a chart, and what its title says; nothing is measured here."""

import dataclasses
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from test_chart import INFO, ROW, row

from pbd_warp.accuracy import peers
from pbd_warp.accuracy.chart import Chart
from pbd_warp.accuracy.chart import save as save_chart
from pbd_warp.accuracy.peers import PeerRow, front, fronts
from pbd_warp.accuracy.plot import draw
from pbd_warp.accuracy.title import seen, seen_of_peers

NAN = float("nan")


def peer(name, ms, error, scene="chain", steps=1, outcome="measured"):
    return PeerRow(scene, name, "RK4", steps, ms, 0.1, error, outcome)


PEERS = (
    peer("pbd-warp", 0.5, 1e-4),
    peer("pbd-warp", 1.0, 1e-8),
    peer("mujoco", 4.0, 1e-4),
    peer("mujoco", 9.0, 1e-3),  # beaten by the one above
    peer("mujoco", 32.0, 1e-6),
    peer("newton", 100.0, 1e-2),
    peer("newton", NAN, NAN, outcome="FloatingPointError: warned"),
    peer("pyelastica", NAN, NAN, steps=0, outcome="NotImplementedError: has no rigid links"),
)


def test_fronts_are_of_others_that_got_somewhere():
    assert front(PEERS, "chain", "mujoco") == [PEERS[2], PEERS[4]]
    assert fronts(PEERS) == {"mujoco": [PEERS[2], PEERS[4]], "newton": [PEERS[5]]}


def test_what_is_saved_is_loaded(tmp_path):
    peers.save(list(PEERS), INFO, tmp_path / "p.csv")
    assert peers.load(tmp_path / "p.csv") == (PEERS, INFO)


def test_the_title_says_which_is_fastest_within_which_error():
    dop853 = dataclasses.replace(row(1e-9, 2.0), method="none", integrator="dop853", error=1e-9)
    rows = [row(2e-3, 1.0, method="jacobi", integrator="pbd"), dop853, row(1e-7, 3.0)]
    assert seen(rows) == "fastest within an error: jacobi, pbd (0.1 to 0.01 m); dop853 (0.001 to 1e-09 m)"
    assert seen([row(NAN, outcome="diverged")]) == "nothing came to an end"


def test_the_title_compares_with_others_where_they_get():
    said = seen_of_peers(PEERS)
    assert said == ("Within 1e-05 m MuJoCo takes 32 times as long; Newton, PyElastica do not get there.")
    assert seen_of_peers(()) == seen_of_peers(PEERS[5:]) == ""


def test_others_are_grey_lines_in_the_panel_of_time(tmp_path):
    pytest.importorskip("matplotlib")
    chart = Chart((row(1e-3, 1.0), row(1e-8, 5.0)), INFO)
    draw(chart, tmp_path / "chart.svg", PEERS)
    root = ElementTree.parse(tmp_path / "chart.svg").getroot()
    ids = {element.get("id") for element in root.iter()}
    assert {"wall-peer-MuJoCo", "wall-peer-Newton"} <= ids
    assert not [name for name in ids if name and ("projections-peer" in name or "peer-PyElastica" in name)]
    text = "\n".join("".join(element.itertext()) for element in root.iter() if element.tag.endswith("text"))
    for wanted in ("MuJoCo", "Newton", "other simulators, best settings", "PyElastica: has no rigid links"):
        assert wanted in text


def test_the_command_draws_those_of_its_scene(tmp_path):
    pytest.importorskip("matplotlib")
    save_chart(Chart((ROW,), INFO), tmp_path / "c.csv")
    others = [dataclasses.replace(r, scene="chain of 50 links") for r in PEERS[:3]]
    peers.save([*others, *PEERS[4:]], INFO, tmp_path / "p.csv")
    command = [sys.executable, "-c", "from pbd_warp.cli import main; main()", "chart", "--from-csv", "c.csv"]
    subprocess.run([*command, "--peers", "p.csv", "--out", "c.svg"], cwd=tmp_path, check=True)
    drawn = (tmp_path / "c.svg").read_text()
    assert "wall-peer-Newton" in drawn
    result = subprocess.run(
        [*command, "--peers", "c.csv", "--out", "c.svg"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert result.returncode == 2
    assert "the columns must be scene, peer" in result.stderr


def test_the_page_has_a_place_for_each_table():
    page = (Path(__file__).parent.parent / "docs" / "methods.md").read_text()
    for name in ("cheapest", "peers", "unable"):
        assert page.count(f"<!-- table: {name} -->\n") == 1
    assert page.count("<!-- end of table -->\n") == 3


def test_scenes_with_others_are_scenes_that_there_are():
    """The committed comparison is of this table's columns, with ours in each of its scenes."""
    rows, info = peers.load(Path(__file__).parent.parent / "pbd_warp" / "accuracy" / "peers.csv")
    assert {"machine", "versions", "measured"} <= set(info)
    for scene in {r.scene for r in rows}:
        assert front(rows, scene, peers.OURS)
