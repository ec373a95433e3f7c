"""Measures against values worked out by hand."""

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.run import run


def test_energy_and_momenta():
    builder = pbd.ModelBuilder(gravity=(0, -10, 0))
    builder.add_particles([(0, 2, 0), (3, 2, 0), (9, 9, 9)], [(1, 0, 0), (0, 2, 0), (0, 0, 0)], mass=[2, 1, 0])
    builder.add_distance(0, 1, rest_length=2.0, compliance=0.25)
    builder.add_point(1, target=(3, 0, 0), compliance=0.5)
    now = pbd.measure(pbd.Simulation(builder.finalize(dtype="float64")))
    # Kinetic 1 + 2, height 40 + 20, springs 1/2 1^2 / 0.25 and 1/2 2^2 / 0.5.
    assert now.energy == pytest.approx(3.0 + 60.0 + 2.0 + 4.0)
    np.testing.assert_allclose(now.momentum, (2, 2, 0))
    np.testing.assert_allclose(now.angular_momentum, (0, 0, 2 * -2 + 3 * 2))
    assert now.max_stretch == pytest.approx(0.5)
    assert now.residual == 0.0, "what is compliant is meant to give"


def test_residual_is_the_largest_of_all_that_should_hold():
    builder = pbd.ModelBuilder()
    builder.add_particles([(0, 0, 0), (1.25, 0, 0)])
    builder.add_distance(0, 1, rest_length=1.0)
    assert pbd.measure(pbd.Simulation(builder.finalize())).residual == 0.25
    builder.add_point(0, target=(0, 0.5, 0))
    assert pbd.measure(pbd.Simulation(builder.finalize())).residual == 0.5


@pytest.mark.parametrize("collider", ["plane", "sphere", "particle"])
def test_overlap(collider):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particle((0, 1.0, 0), radius=0.5)
    if collider == "plane":
        builder.add_plane((0, 0.75, 0), (0, 1, 0))
    elif collider == "sphere":
        builder.add_sphere((0, -1, 0), 1.75)
    else:
        builder.add_particle((0, 1.75, 0), radius=0.5)
        builder.enable_contacts()
    sim = pbd.Simulation(builder.finalize(dtype="float64"), max_contacts=4, capture=False)
    if sim._loop.contacts:
        sim._loop.contacts.find()
    now = pbd.measure(sim)
    assert now.overlap == now.residual == pytest.approx(0.25)


def test_frames_in_which_links_stretch_are_counted(tmp_path):
    """200 links led by their head: a sweep a step does not reach the tail, and no check knows what a drag will do."""
    (tmp_path / "dragged.py").write_text(
        "import numpy as np, pbd_warp as pbd\n"
        "def scene():\n"
        "    builder = pbd.ModelBuilder(gravity=(0, 0, 0))\n"
        "    rope = builder.add_rope(np.linspace([0, 0, 0], [-1, 0, 0], 201), mass=0.5, pinned=())\n"
        "    drag = [(0.0, 'select', rope[0]), (0.5, 'move', (1.0, 0.0, 0.0))]\n"
        "    return pbd.Scene(builder, frames=20, method='gauss-seidel', substeps=2, drag=drag)\n"
    )
    scene = pbd.load_scene(str(tmp_path / "dragged.py"))
    swept = run(scene, tmp_path / "swept.usdc")
    assert swept.max_stretch > 0.2
    assert swept.stretched_frames > 0
    direct = run(scene.changed(method="direct"), tmp_path / "direct.usdc")
    assert (direct.stretched_frames, direct.unconverged) == (0, 0)
