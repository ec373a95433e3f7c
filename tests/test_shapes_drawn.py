"""Colliders as what they are: in USD files, in the view's description, in pictures."""

from pathlib import Path

import numpy as np
import pytest
from meshes import torus
from pxr import Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.drawing.surroundings import describe
from pbd_warp.model.rotation import quaternion, rotate
from pbd_warp.player.render import Renderer
from pbd_warp.run import run
from pbd_warp.scene import Scene


def all_shapes():
    builder = pbd.ModelBuilder()
    builder.add_particles([(-1, 1, -1), (1, -1, 1)], radius=0.05, mass=0.0)
    builder.add_box((-0.5, 0, 0), (0.4, 0.3, 0.2), (0.2, 0.3, 0.1))
    builder.add_capsule((0, 0, -0.3), (0, 0, 0.3), 0.1)
    builder.add_cylinder((-0.4, -0.4, 0), (-0.2, -0.4, 0.4), 0.1)
    builder.add_cone((0.5, -0.2, 0), (0.5, 0.3, 0), 0.2)
    builder.add_mesh(*torus(0.2, 0.05), (0, 0.5, 0), (0.5, 0, 0))
    builder.let_collider_move(builder.add_sphere((0, -0.4, 0.2), 0.15), (1.2, 0, 0))
    builder.let_collider_move(builder.add_box((0, -0.8, 0), (0.4, 0.1, 0.2)), angular_velocity=(0, 0, 3.0))
    return builder


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_file_has_each_as_what_it_is_where_it_is(tmp_path, up):
    builder = all_shapes()
    run(Scene(builder, 13), tmp_path / "a.usda", up_axis=up)
    stage = Usd.Stage.Open(str(tmp_path / "a.usda"))
    prims = stage.GetPrimAtPath("/World/Colliders").GetChildren()
    assert [p.GetTypeName() for p in prims] == ["Cube", "Capsule", "Cylinder", "Mesh", "Mesh", "Sphere", "Cube"]

    def corners(k, frame):
        """Those of its extent, in the world, y up."""
        extent = np.array(UsdGeom.Boundable(prims[k]).GetExtentAttr().Get())
        box = np.array(np.meshgrid(*extent.T)).reshape(3, 8).T
        matrix = np.array(UsdGeom.Imageable(prims[k]).ComputeLocalToWorldTransform(frame))
        x = box @ matrix[:3, :3] + matrix[3, :3]
        return x if up == "Y" else np.stack([x[:, 0], x[:, 2], -x[:, 1]], axis=1)

    def expected(k, half, frame):
        c, time = builder.finalize().colliders, frame / 60.0
        box = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, 8).T * half
        own = rotate(c.rotation[k], box)
        return rotate(quaternion(time * c.spin[k]), own) + c.centre[k] + time * c.velocity[k]

    halves = {0: (0.2, 0.15, 0.1), 1: (0.1, 0.4, 0.1), 2: (0.1, np.hypot(0.2, 0.4) / 2, 0.1), 3: (0.2, 0.25, 0.2)}
    halves |= {4: (0.25, 0.05, 0.25), 5: (0.15, 0.15, 0.15), 6: (0.2, 0.05, 0.1)}
    for k, half in halves.items():
        for frame in (0, 12):
            there, right = corners(k, frame), expected(k, half, frame)
            apart = np.linalg.norm(there[:, None] - right, axis=2)
            assert apart.min(axis=0).max() < 1e-5, (k, frame)


def test_the_view_is_told_of_all_but_planes_and_spheres_at_rest():
    builder = all_shapes()
    builder.add_plane((0, -2, 0), (0, 1, 0))
    builder.add_sphere((0, 3, 0), 0.5)
    told = describe(builder.finalize())
    assert len(told["solids"]) == 7
    assert told["spheres"] == [[0.0, 3.0, 0.0, 0.5]]
    assert len(told["planes"]) == 1
    assert told["solids"][5]["velocity"] == [1.2, 0.0, 0.0]
    assert told["solids"][6]["spin"] == [0.0, 0.0, 3.0]


def test_a_picture_shows_them_where_they_are_then():
    """A box that moves: its pixels are around where its middle is seen, before and after."""
    builder = pbd.ModelBuilder()
    builder.add_particles([(-1, 1, -1), (1, -1, 1)], radius=0.001, mass=0.0)
    builder.let_collider_move(builder.add_box((-0.5, 0, 0), (0.2, 0.2, 0.2)), (1.0, 0, 0))
    motion = pbd.Simulation(builder.finalize()).run(frames=60)
    renderer = Renderer(motion.drawn, motion.drawn.around(motion.positions), 320, 200)
    empty = Renderer(
        type(motion.drawn)(**{**vars(motion.drawn), "solids": ()}), motion.drawn.around(motion.positions), 320, 200
    )
    for time in (0.0, 1.0):
        seen = np.any(renderer.draw(motion.positions[0], time) != empty.draw(motion.positions[0]), axis=2)
        rows, columns = np.nonzero(seen)
        middle, _ = renderer.eye.project(np.array([[-0.5 + time, 0, 0]]))
        assert len(rows) > 100
        np.testing.assert_allclose([columns.mean(), rows.mean()], middle[0], atol=4.0)


def test_going_back_and_on_makes_the_same_frames_with_colliders_that_move():
    def play(sim, frames):
        for _ in range(frames):
            sim.step()
        return sim.positions

    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace((-0.5, 0.3, 0), (0.5, 0.3, 0), 12), radius=0.03, pinned=())
    drum = builder.add_cylinder((0, 0, -1), (0, 0, 1), 0.25, friction=0.5)
    builder.let_collider_move(drum, angular_velocity=(0, 0, 2.0))
    sim = pbd.Simulation(builder.finalize("cpu"), substeps=4)
    play(sim, 20)
    kept = sim.positions, sim.velocities, sim.collider_motion
    end = play(sim, 15)
    sim.go_back(20, *kept)
    np.testing.assert_array_equal(play(sim.continue_with(), 15), end)


def test_a_checkpoint_goes_on_with_what_moves(tmp_path):
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace((-0.5, 0.3, 0), (0.5, 0.3, 0), 12), radius=0.03, pinned=())
    box = builder.add_box((0, 0, 0), (0.4, 0.4, 2.0), friction=0.5)
    builder.let_collider_move(box)

    def play(sim, first, last):
        for frame in range(first, last):
            sim.move_collider(box, (0.01 * frame, 0.02 * np.sin(0.3 * frame), 0), (0, 0, 0.1 * frame))
            sim.step()
        return sim

    whole = play(pbd.Simulation(builder.finalize("cpu"), substeps=4), 0, 30)
    part = play(pbd.Simulation(builder.finalize("cpu"), substeps=4), 0, 12)
    part.save(Path(tmp_path) / "c.npz")
    on = play(pbd.Simulation.load(Path(tmp_path) / "c.npz"), 12, 30)
    np.testing.assert_array_equal(on.positions, whole.positions)
    np.testing.assert_allclose(whole.collider_places[0][box], [0.29, 0.02 * np.sin(8.7), 0], atol=1e-6)
    whole.reset()
    np.testing.assert_array_equal(play(whole, 0, 30).positions, on.positions)
    last = on.collider_places[0][box]
    on.step(frames=3)
    np.testing.assert_array_equal(on.collider_places[0][box], last)
    with pytest.raises(pbd.InputError, match="there is no collider 1: there are 1"):
        on.move_collider(1, (0, 0, 0))


def test_a_frame_made_again_begins_with_colliders_where_they_were():
    """A method with too few iterations, whose frames are subdivided: the wall goes on as if nothing was."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace((0, 0, 0), (1, 0, 0), 9), pinned=(0,))
    wall = builder.add_box((0, -9, 0), (0.2, 1, 1))
    builder.let_collider_move(wall, (1.0, 0, 0), (0, 1.0, 0))
    sim = pbd.Simulation(builder.finalize("cpu", "float64"), method=pbd.Direct(iterations=2), on_failure="subdivide")
    sim.step(frames=30)
    assert sim.retried > 0
    place, turn = (each[wall] for each in sim.collider_places)
    np.testing.assert_allclose(place, [0.5, -9, 0], atol=1e-12)
    np.testing.assert_allclose(turn, quaternion(np.array([0, 0.5, 0])), atol=1e-12)
