"""What each scene promises to show, and scene files of the user's own."""

import sys

import numpy as np
import pytest
from models import FOUR_SCENES, state

import pbd_warp as pbd
from pbd_warp.stability.cell import run_scene
from pbd_warp.stability.classify import classify


@pytest.fixture(scope="module")
def runs():
    """Every scene to its end, at its own settings: (scene, positions [frames, n, 3], measures of every frame)."""
    done = {}
    for name in FOUR_SCENES:
        scene = pbd.load_scene(name)
        sim = pbd.Simulation(scene.builder.finalize(), scene.settings)
        drag = pbd.Drag(scene.drag)
        positions, measures = [state(sim)[0]], [pbd.measure(sim)]
        for _ in range(scene.frames - 1):
            drag.advance(sim)
            sim.step()
            positions.append(state(sim)[0])
            measures.append(pbd.measure(sim))
        done[name] = scene, np.array(positions), measures
    return done


def frame_at(scene, gesture):
    """First frame number at or after the gesture of that index."""
    return int(np.ceil(scene.drag[gesture][0] * scene.fps))


def test_all_scenes_are_known_and_have_a_drag(runs):
    assert set(pbd.scene_names()) > set(runs)
    for scene, _, _ in runs.values():
        assert [gesture[1] for gesture in (scene.drag[0], scene.drag[-1])] == ["select", "deselect"]


def test_the_worm_follows_its_head(runs):
    scene, x, measures = runs["worm"]
    # Nothing but the grabber moves it.
    np.testing.assert_allclose(x[frame_at(scene, 0)], x[0], atol=1e-6)
    end = frame_at(scene, -1)
    travelled = np.linalg.norm(np.diff(x[:end], axis=0), axis=2).sum(axis=0)
    assert travelled.min() > 1.0
    assert max(m.max_stretch for m in measures) < 0.01
    # No gravity and no walls: the worm as a whole drifts on when it is free.
    momentum = [m.momentum for m in measures[end + 2 :]]
    np.testing.assert_allclose(momentum, momentum[:1] * len(momentum), atol=1e-4)


def test_no_discs_overlap(runs):
    scene, x, _ = runs["collision"]
    radius = scene.builder.finalize().radius
    i, j = np.triu_indices(len(radius), 1)
    gap = np.linalg.norm(x[:, i] - x[:, j], axis=2) - (radius[i] + radius[j])
    assert gap.min() >= -0.01 * radius.min()
    low, high = (x - radius[:, None]).min(axis=(0, 1)), (x + radius[:, None]).max(axis=(0, 1))
    assert low[:2].min() >= -0.01 * radius.min()
    assert np.all(high[:2] <= np.array([2.0, 1.4]) + 0.01 * radius.min())
    # Some fly, some rest, and the grabbed one pushes more than it holds.
    speed = np.linalg.norm(x[1] - x[0], axis=1)
    assert 0 < np.count_nonzero(speed) < len(radius)
    before, after = frame_at(scene, 0), frame_at(scene, -1)
    assert np.count_nonzero(np.linalg.norm(x[after] - x[before], axis=1) > 0.1) > 5
    assert np.all(x[..., 2] == 0.0)


def test_a_disc_that_nothing_touches_keeps_its_velocity(runs):
    """The inequality acts only on contact: in every frame most pairs are apart and their discs go straight on."""
    _, x, _ = runs["collision"]
    change = np.linalg.norm(np.diff(x[:30], n=2, axis=0), axis=2)
    assert np.count_nonzero(change < 1e-6) > 0.8 * change.size
    assert np.count_nonzero(change > 1e-3) > 5


def test_the_point_stays_locked(runs):
    _, x, measures = runs["point"]
    locked = np.linalg.norm(x[:, 0], axis=1)
    reach = np.linalg.norm(x[:, -1], axis=1)
    within = reach < 1.0
    assert locked[within].max() < 0.005
    assert reach.max() > 1.25, "the grabber goes further than the chain can reach"
    # Then no solution exists; the chain is straight, evenly stretched, and takes part of the way at the locked end too.
    far = x[int(reach.argmax())]
    assert np.ptp(np.linalg.norm(np.diff(far, axis=0), axis=1)) < 0.02
    assert abs(far[:, 1]).max() < 0.02
    assert measures[-1].max_stretch < 0.01


def test_the_rope_swings_whips_and_comes_to_hang(runs):
    scene, x, measures = runs["rope"]
    assert max(m.max_stretch for m in measures) < 0.01
    assert x[:, :, 0].min() < -0.8, "it swings to the other side"
    speed = np.linalg.norm(np.diff(x, axis=0), axis=2) * scene.fps
    # A rigid rod's tip would reach sqrt(3 g L).
    assert speed[: frame_at(scene, 0), -1].max() > 1.3 * np.sqrt(3 * 9.81)
    hanging = np.linspace(0.0, -1.0, x.shape[1])
    np.testing.assert_allclose(x[-1, :, 1], hanging, atol=0.005)
    assert abs(x[-1, :, 0]).max() < 0.01
    assert speed[-1].max() < 0.1


@pytest.mark.parametrize("name", FOUR_SCENES)
def test_no_particle_ever_jumps(runs, name):
    _, x, _ = runs[name]
    assert np.linalg.norm(np.diff(x, axis=0), axis=2).max() < 0.25


@pytest.mark.parametrize("name", [name for name in pbd.scene_names() if pbd.load_scene(name).reference])
def test_study_scenes_stay_close_to_their_reference(name):
    """At their own settings, after one second, within 1 mm of what is exactly known."""
    scene = pbd.load_scene(name)
    sim = pbd.Simulation(scene.builder.finalize(dtype="float64"), scene.settings)
    for _ in range(60):
        sim.step()
    error = np.abs(state(sim)[0] - scene.reference(1.0)).max()
    assert error < 1e-3
    np.testing.assert_allclose(scene.reference(0.0), sim.model.x, atol=1e-12)


UNSOLVED = {"overconstrained": "stretched", "point": "stretched", "deep_overlap": "gained energy"}
"""What these promise to show: sides that cannot fit, a hand out of reach, discs that fly on."""


@pytest.mark.parametrize("name", [name for name in pbd.scene_names() if not pbd.load_scene(name).reference])
def test_every_scene_holds_at_its_own_settings(name):
    """To its end, in float32. Drags, and errors that a scene starts with, bring in energy of their own."""
    scene = pbd.load_scene(name)
    driven = bool(scene.drag) or name in ("coincident", "overconstrained")
    assert classify(run_scene(scene, "float32", energy=not driven)) == UNSOLVED.get(name, "converged")


def test_a_star_of_no_such_shape():
    with pytest.raises(pbd.InputError, match=r"unknown shape of the star 'plane': .* did you mean 'planar'"):
        pbd.load_scene("star", parameters={"shape": "plane"})


def test_settings_of_a_scene():
    assert pbd.load_scene("chain", parameters={"links": "4"}).builder.particle_count == 5
    with pytest.raises(pbd.InputError, match="unknown parameter of scene chain 'link': there is links; did you mean"):
        pbd.load_scene("chain", parameters={"link": "4"})
    with pytest.raises(pbd.InputError, match="parameter links of scene chain must be like 9, not 'four'"):
        pbd.load_scene("chain", parameters={"links": "four"})
    with pytest.raises(pbd.InputError, match="scene rope has no parameters"):
        pbd.load_scene("rope", parameters={"links": "4"})


def test_without_scipy_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pbd_warp.accuracy.references", None)
    with pytest.raises(pbd.InputError, match=r"references need SciPy: pip install 'pbd-warp\[chart\]'"):
        pbd.load_scene("catenary")


def test_a_seed_changes_what_is_random_and_only_that():
    first, same, other = (pbd.load_scene("collision", seed=s).builder.finalize() for s in (1, 1, 2))
    np.testing.assert_array_equal(first.v, same.v)
    assert not np.array_equal(first.v, other.v)
    with pytest.raises(pbd.InputError, match="nothing random"):
        pbd.load_scene("rope", seed=1)


GOOD = """
import pbd_warp as pbd

def scene():
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 1, 0))
    return pbd.Scene(builder, frames=3)
"""


def test_a_scene_file_of_the_users_own(tmp_path):
    path = tmp_path / "my_scene.py"
    path.write_text(GOOD)
    scene = pbd.load_scene(str(path))
    assert scene.name == "my_scene"
    assert scene.frames == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1 / 0", r"fails to import: ZeroDivisionError: division by zero \(bad.py, line 1\)"),
        ("def scene(:", r"fails to import: SyntaxError: .*line 1"),
        ("import no_such_module", "fails to import: ModuleNotFoundError: No module named 'no_such_module'"),
        ("x = 1", r"has no function scene\(\)"),
        ("def scene():\n    return 3", "must return a pbd_warp.Scene, not int"),
        ("def scene():\n    return [][1]", r"fails to build: IndexError: .* \(bad.py, line 2\)"),
        (
            "import pbd_warp as pbd\ndef scene():\n    pbd.ModelBuilder().add_particle((0, 0, float('nan')))",
            "position must be finite",
        ),
    ],
)
def test_bad_scene_files(tmp_path, text, message):
    path = tmp_path / "bad.py"
    path.write_text(text)
    with pytest.raises(pbd.InputError, match=message):
        pbd.load_scene(str(path))


@pytest.mark.parametrize(("name", "message"), [("roap", "did you mean 'rope'"), ("no/such.py", "no scene file")])
def test_unknown_scenes(name, message):
    with pytest.raises(pbd.InputError, match=message):
        pbd.load_scene(name)
