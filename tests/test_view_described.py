"""What pages are told of a scene."""

import json

import numpy as np
import pytest
from sessions import open_scene

import pbd_warp as pbd
from pbd_warp.drawing.surroundings import describe
from pbd_warp.view import messages as say
from pbd_warp.view.remedies import remedies
from pbd_warp.view.report import description, status

SOLID = {"knot", "groom", "links", "pile"}
"""Scenes that do not lie in a plane."""


@pytest.mark.parametrize("name", pbd.scene_names())
def test_every_scene_is_described(name):
    session = open_scene(name)
    told = json.loads(json.dumps(description(session), allow_nan=False))
    model = pbd.load_scene(name).builder.finalize()
    assert len(told["radius"]) == model.particle_count
    assert min(told["radius"]) > 0.0
    assert told["links"] == model.distance.edge.tolist()
    flat = None if name in SOLID else 2
    assert told["axis"] == flat, "what lies in a plane opens face-on"
    assert (told["ground"] is not None) == (name == "pile"), "only what lies on one has a ground"
    if name == "collision":
        corners = np.array(told["planes"])
        assert corners.shape == (4, 4, 3)
        np.testing.assert_allclose(corners.min(axis=(0, 1))[:2], (0, 0), atol=1e-9)
        np.testing.assert_allclose(corners.max(axis=(0, 1))[:2], (2.0, 1.4), atol=1e-9)
        walls = np.array(told["walls"])
        assert walls.shape == (4, 4, 3)
        inside = np.all((walls[..., :2] > 1e-9) & (walls[..., :2] < np.array((2.0, 1.4)) - 1e-9), axis=-1)
        assert not inside.any(), "no wall reaches into the box"
    if name == "rope":
        np.testing.assert_allclose(told["low"][:2], (-1, -1), atol=0.02)  # where it can swing
        assert told["fixed"] == [0]
    now = json.loads(json.dumps(status(session), allow_nan=False))
    for plot in told["plots"]:
        assert plot in now


def test_plots_are_of_what_there_is():
    assert set(description(open_scene("rope"))["plots"]) == {
        *("energy", "kinetic", "potential", "max_stretch", "residual", "ms"),
    }
    assert set(description(open_scene("collision"))["plots"]) == {"kinetic", "residual", "ms"}
    assert status(open_scene("rope"))["iterations"] is None, "always the same number"
    session = open_scene("chain")
    session.advance()
    assert status(session)["iterations"] >= 2
    assert status(session)["unconverged"] == 0


def test_kinetic_and_potential_energy_make_the_energy():
    session = open_scene("rope")
    for _ in range(20):
        session.advance()
    now = status(session)
    v = session.sim.state.v.numpy().astype(np.float64)
    assert now["kinetic"] == pytest.approx(0.5 * session.model.mass @ np.sum(v * v, axis=1), rel=1e-12)
    assert now["kinetic"] + now["potential"] == pytest.approx(now["energy"], rel=1e-12)
    assert now["potential"] < 0.0 < now["kinetic"]


def test_scenes_come_with_their_parameters():
    scenes = description(open_scene("chain", parameters={"links": "5"}))
    assert scenes["parameters"] == {"links": "5"}
    assert scenes["scenes"]["chain"] == {
        "summary": "A chain of rigid links falls from the horizontal and whips.",
        "text": "`links`: how many the metre is made of.",
        "parameters": {"links": 9},
    }
    assert scenes["scenes"]["rope"]["parameters"] == {}


def test_what_is_known_to_fail_is_told_with_its_remedies():
    session = open_scene("heavy_bob", parameters={})
    session.do(1, say.Change({"method": "gauss-seidel", "substeps": 1, "iterations": 1}))
    (warning, *_) = status(session)["warnings"]
    assert "mass ratio" in warning["text"]
    assert {"label": "Direct", "changes": {"method": "direct"}} in warning["remedies"]
    assert {"label": "2 substeps", "changes": {"substeps": 2}} in warning["remedies"]


def test_remedies_are_read_from_sentences():
    now = pbd.load_scene("rope").settings
    wanted = {"integrator": "bdf2"}
    text = "integrator 'bdf2' does not model damping: leave it out or use integrator 'pbd'"
    assert remedies(text, now, "float32", wanted) == [
        {"label": "Damping 0", "changes": {"integrator": "bdf2", "damping": 0.0}}
    ]
    assert remedies("9 contacts; give Simulation or Scene max_contacts=18 or more", now, "float32") == [
        {"label": "Room for 18", "changes": {"max_contacts": 18}}
    ]
    assert remedies("use float64, or move the scene to the origin", now, "float64") == [], "it is already"
    assert remedies("page 1 is dragging; wait until it lets go", now, "float32") == []
    assert remedies("with more care", now, "float32") == []


def test_a_scene_in_space_and_its_colliders():
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (0.5, 0, 0.3), (1, 0.2, 0)], radius=0.0)
    builder.add_plane((0, -2, 0), (0, 1, 0))
    builder.add_sphere((0.5, -1, 0), 0.25)
    told = describe(builder.finalize())
    assert told["axis"] is None
    assert told["spheres"] == [[0.5, -1.0, 0.0, 0.25]]
    assert np.allclose(np.array(told["planes"])[..., 1], -2.0)
    assert told["ground"] == -2.0
    assert told["walls"] == []


def test_the_ground_is_where_there_is_one():
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (0.5, 0, 0.3), (1, 0.2, 0)])
    assert describe(builder.finalize())["ground"] is None
    builder.add_plane((0, -2, 0), (1, 1, 0))
    assert describe(builder.finalize())["ground"] is None, "a slope"
