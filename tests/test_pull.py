"""A grab that pulls: it arrives, it is bounded, and what is in the way or holds the particle wins."""

import numpy as np
import pytest
from models import rope_model, state

import pbd_warp as pbd
from pbd_warp.grab.grabber import Grabber
from pbd_warp.step.integrators import INTEGRATORS
from pbd_warp.step.pull import RESPONSE

PULL = {"grab_acceleration": 100.0}


def particle_model(dtype="float64", **plane):
    builder = pbd.ModelBuilder(gravity=(0, -9.81, 0))
    builder.add_particle((0, 0, 0), mass=2.0, radius=0.1)
    if plane:
        builder.add_plane(**plane)
    return builder.finalize(dtype=dtype)


def test_nothing_is_launched_where_nothing_can_be_pulled():
    assert "pull" not in pbd.Simulation(rope_model(3)).passes
    assert pbd.Simulation(rope_model(3), **PULL).passes.count("pull") == 1


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("substeps", [2, 16])
def test_a_particle_arrives_and_rests_at_its_target_in_spite_of_gravity(integrator, substeps, dtype):
    """Not below it, as on a spring. A midpoint rule moves by the mean of the velocities before and after gravity in a
    step, g h / 2 apart from the one that the pull sees; what makes up for that is a distance of T times as much."""
    sim = pbd.Simulation(particle_model(dtype), integrator=integrator, substeps=substeps, **PULL)
    sim.grab(0)
    sim.move_to((0.3, 0.2, -0.1))
    for _ in range(120):
        sim.step()
    x, v = state(sim)
    off = 0.5 * 9.81 * sim.settings.step_dt
    np.testing.assert_allclose(x[0], (0.3, 0.2, -0.1), atol=2e-5 + off * max(RESPONSE, 3 * sim.settings.step_dt))
    np.testing.assert_allclose(v[0], 0.0, atol=2e-3 + off)


@pytest.mark.parametrize("method", [pbd.Direct(), pbd.GaussSeidel(iterations=1), pbd.Jacobi(iterations=20)])
def test_the_end_of_a_rope_comes_along(method):
    sim = pbd.Simulation(rope_model(11, mass=0.4), method=method, substeps=32, damping=0.3, **PULL)
    sim.grab(10)
    for frame in range(1, 121):
        sim.move_to((1.0 - 0.4 * min(1.0, frame / 60), -0.1, 0))
        sim.step()
    np.testing.assert_allclose(state(sim)[0][10], (0.6, -0.1, 0), atol=1e-3)


def test_force_and_speed_are_bounded():
    """What is free gets no faster than the bound, and not sooner than the force allows."""
    sim = pbd.Simulation(particle_model(), substeps=16, gravity=(0, 0, 0), grab_acceleration=60.0, grab_speed=3.0)
    sim.grab(0)
    sim.move_to((1000.0, 0.0, 0.0))
    for frame in range(1, 31):
        sim.step()
        speed = np.linalg.norm(state(sim)[1][0])
        assert speed <= min(3.0, 60.0 * frame / 60) * (1 + 1e-9)
    assert speed == pytest.approx(3.0, rel=1e-6)


def test_the_force_is_that_over_the_mass_of_all_that_is_joined():
    """A rope that hangs by its upper end: held by more than its weight, else it falls."""
    for acceleration, held in ((11.0, True), (9.0, False)):
        builder = pbd.ModelBuilder()
        builder.add_rope([(0, -0.1 * k, 0) for k in range(6)], mass=3.0, pinned=())
        model = builder.finalize(dtype="float64")
        sim = pbd.Simulation(model, substeps=32, method=pbd.Direct(), grab_acceleration=acceleration)
        sim.grab(0)
        for _ in range(120):
            sim.step()
        assert (state(sim)[0][0, 1] > -0.01) == held
        assert (state(sim)[0][0, 1] < -1.0) != held


@pytest.mark.parametrize("speed", [10.0, 1000.0])
def test_walls_win(speed):
    model = particle_model(point=(0.5, 0, 0), normal=(-1, 0, 0))
    sim = pbd.Simulation(model, substeps=16, method=pbd.Jacobi(iterations=4), **PULL, grab_speed=speed)
    sim.grab(0)
    for frame in range(90):
        sim.move_to((0.05 * frame, 0.0, 0.0))
        sim.step()
        assert state(sim)[0][0, 0] <= 0.4 + 1e-3
    assert state(sim)[0][0, 0] == pytest.approx(0.4, abs=1e-3)
    exact = pbd.Simulation(model, substeps=16, method=pbd.Jacobi(iterations=4))
    exact.grab(0)
    exact.move_to((1.0, 0.0, 0.0))
    exact.step()
    assert state(exact)[0][0, 0] == 1.0, "which an exact grab does not care for"


def test_contacts_win():
    """Held against a disc that stands at a wall: neither overlaps."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (0.3, 0, 0)], mass=[2.0, 0.5], radius=0.1)
    builder.add_plane((0.5, 0, 0), (-1, 0, 0))
    builder.enable_contacts()
    sim = pbd.Simulation(builder.finalize(dtype="float64"), substeps=16, method=pbd.Jacobi(iterations=10), **PULL)
    sim.grab(0)
    for _ in range(90):
        sim.move_to((2.0, 0.0, 0.0))
        sim.step()
        assert pbd.measure(sim).overlap < 2e-3
    assert state(sim)[0][0, 0] == pytest.approx(0.2, abs=4e-3)


@pytest.mark.parametrize("particle", [5, 10, 0])
def test_lengths_win(particle):
    """Also where a fixed particle is dragged away from another one."""
    sim = pbd.Simulation(rope_model(11, pinned=(0, -1)), substeps=48, damping=0.05, **PULL)
    sim.grab(particle)
    for frame in range(90):
        sim.move_to((-0.1 * frame, 0.1 * frame, 0.0))
        sim.step()
        assert pbd.measure(sim).max_stretch < 0.06
    assert np.isfinite(state(sim)[0]).all()


@pytest.mark.parametrize("frame", range(0, 120, 8))
def test_a_whipping_rope_that_is_pulled_back_stretches_a_little(frame):
    """The scene's own single sweep a step, its tip at any moment of its fall, led far out of reach within 0.2 s."""
    scene = pbd.load_scene("rope")
    sim = pbd.Simulation(scene.builder, scene.settings, **PULL)
    if frame:
        sim.step(frame)
    sim.grab(20)
    start, far = sim.positions[20], np.array([-1.6, 1.6, 0.0])
    most = 0.0
    for k in range(60):
        sim.move_to(start + min(1.0, k / 12.0) * (far - start))
        sim.step()
        most = max(most, pbd.measure(sim).max_stretch)
    assert most < 0.2


def test_a_fixed_particle_is_dragged_and_stays_where_it_is_let_go_of():
    sim = pbd.Simulation(rope_model(3), substeps=8, **PULL)
    sim.grab(0)
    sim.move_to((0.0, 0.3, 0.0))
    for _ in range(90):
        sim.step()
    sim.release()
    where = state(sim)[0][0]
    np.testing.assert_allclose(where, (0, 0.3, 0), atol=1e-3)
    for _ in range(5):
        sim.step()
    np.testing.assert_array_equal(state(sim)[0][0], where)
    np.testing.assert_array_equal(state(sim)[1][0], 0.0)


def test_direct_pulls_no_fixed_particle_and_says_so():
    sim = pbd.Simulation(rope_model(3), substeps=8, **PULL)
    sim.grab(0)
    with pytest.raises(pbd.InputError, match="particle 0 is fixed, and method 'direct' takes no fixed particle"):
        sim.continue_with(method=pbd.Direct())
    direct = pbd.Simulation(rope_model(3), method=pbd.Direct(), **PULL)
    with pytest.raises(pbd.InputError, match="grab it exactly"):
        direct.grab(0)
    direct.grab(1)
    direct.step()
    exact = direct.continue_with(grab_acceleration=None)
    exact.grab(0)
    exact.step()


def test_what_is_let_go_of_flies_on():
    sim = pbd.Simulation(particle_model(), substeps=8, gravity=(0, 0, 0), **PULL)
    sim.grab(0)
    for frame in range(30):
        sim.move_to((0.02 * frame, 0, 0))
        sim.step()
    sim.release()
    assert sim.held is None
    before = state(sim)[0][0, 0]
    sim.step()
    assert state(sim)[0][0, 0] - before == pytest.approx(0.02, rel=0.02)


def test_it_is_where_its_target_is_also_while_that_moves():
    sim = pbd.Simulation(particle_model(), substeps=16, gravity=(0, 0, 0), **PULL)
    sim.grab(0)
    for frame in range(1, 61):
        sim.move_to((frame / 60, 0, 0))  # 1 m/s
        sim.step()
    assert state(sim)[0][0, 0] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("settings", [PULL, {}])
def test_a_checkpoint_in_the_middle_of_a_drag_goes_on_bit_for_bit(settings, tmp_path):
    def drag(sim, frames):
        for _ in range(frames):
            Grabber(sim).move((0.5, 0.01 * sim.frame, 0.0))
            sim.step()
        return state(sim)

    sim = pbd.Simulation(rope_model(6, "float32"), substeps=8, integrator="bdf2", **settings)
    sim.grab(5)
    drag(sim, 10)
    sim.save(tmp_path / "c.npz")
    expected = drag(sim, 10)
    again = pbd.Simulation.load(tmp_path / "c.npz")
    assert again.held == 5
    np.testing.assert_array_equal(drag(again, 10), expected)


def test_a_script_may_pull(tmp_path):
    drag = pbd.Drag([(0.0, "select", 0), (0.5, "move", (2.0, 0.0, 0.0)), (1.0, "deselect")])
    model = particle_model(point=(0.5, 0, 0), normal=(-1, 0, 0))
    sim = pbd.Simulation(model, substeps=8, **PULL)
    for _ in range(50):
        drag.advance(sim).step()
    assert state(sim)[0][0, 0] == pytest.approx(0.4, abs=2e-3)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"grab_acceleration": 0.0}, "grab_acceleration must be a finite number above 0"),
        ({"grab_acceleration": float("inf")}, "grab_acceleration must be"),
        ({"grab_speed": -1.0}, "grab_speed must be a finite number above 0"),
    ],
)
def test_bounds_that_make_no_sense_are_refused(settings, message):
    with pytest.raises(pbd.InputError, match=message):
        pbd.Simulation(rope_model(3), **settings)


def test_only_what_is_grabbed_is_moved():
    sim = pbd.Simulation(rope_model(3), **PULL)
    with pytest.raises(pbd.InputError, match="call grab"):
        sim.move_to((0, 0, 0))
    with pytest.raises(pbd.InputError, match="grab"):
        sim.grab(7)
    sim.grab(1)
    sim.grab(2)
    sim.reset()
    assert sim.held is None
    np.testing.assert_array_equal(sim._context.w.numpy(), sim.model.w)
