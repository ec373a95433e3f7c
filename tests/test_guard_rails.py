"""What fails is noticed in the frame in which it happens, named, and where asked for made again."""

import numpy as np
import pytest
from models import rope_model, state

import pbd_warp as pbd

H = 1.0 / 60.0


def star(spokes, dtype="float32"):
    """A hub and its spokes of 1 m in the plane, all a little too long: the plain sum of corrections diverges."""
    angle = 2.0 * np.pi * np.arange(spokes) / spokes
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), *(1.01 * np.array([np.cos(a), np.sin(a), 0.0]) for a in angle)])
    builder.add_distances([(0, k + 1) for k in range(spokes)], rest_length=1.0)
    return builder.finalize(dtype=dtype)


def pair(apart=1.0, rest_length=1.0, velocity=(0, 0, 0), **kwargs):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (apart, 0, 0)], [(0, 0, 0), velocity])
    builder.add_distance(0, 1, rest_length, **kwargs)
    return builder.finalize(dtype="float64")


def failure(sim, frames=60):
    for _ in range(frames):
        try:
            sim.step()
        except pbd.SimulationFailed as error:
            return str(error)
    raise AssertionError("nothing failed")


# Divergence.


def test_divergence_is_reported_with_all_that_helps():
    message = failure(pbd.Simulation(star(16), method=pbd.Jacobi(averaging="none")))
    assert message.startswith("frame 1 (t = 0.0166667 s): distance 0 is stretched beyond the limit of 1000 %")
    assert "Jacobi(iterations=20, relaxation=1.0, averaging='none'" in message
    assert "integrator 'pbd' and 1 substeps" in message
    assert "the worst constraint is the distance of particles 0 and " in message
    assert "% of its length" in message
    assert message.endswith("keep averaging='mass-splitting' and the relaxation at 1")


@pytest.mark.parametrize("limit", [0.45, 3.1])
def test_the_stretch_limit_is_where_it_is_set(limit):
    """A link that nothing holds in one sweep of stiffness 0 grows by its ends' velocity."""
    speed = 10.0
    sim = pbd.Simulation(pair(velocity=(speed, 0, 0), stiffness=0.0), limits=pbd.Limits(stretch=limit))
    frames = int(np.floor(limit / (speed * H)))
    for _ in range(frames):
        sim.step()
    assert pbd.measure(sim).max_stretch <= limit
    assert f"frame {frames + 1} " in failure(sim, 1)


@pytest.mark.parametrize("limit", [10.0, 1e4, 1e6])
def test_the_remedy_does_not_come_from_where_the_particles_have_flown(limit):
    """Far out float32 rounds, and what is fast goes far in a step: both are consequences here."""
    sim = pbd.Simulation(star(16), method=pbd.Jacobi(averaging="none"), limits=pbd.Limits(stretch=limit))
    assert failure(sim).endswith("keep averaging='mass-splitting' and the relaxation at 1")


def test_a_state_that_was_put_right_goes_on():
    sim = pbd.Simulation(star(16), method=pbd.Jacobi(averaging="none"))
    failure(sim)
    sim.state.x.assign(sim.model.x / 1.01)  # without an error there is nothing to blow up
    sim.state.v.zero_()
    sim.step()


def test_without_a_limit_only_what_is_not_finite_stops():
    sim = pbd.Simulation(star(16), method=pbd.Jacobi(averaging="none"), limits=pbd.Limits(stretch=None))
    sim.step()
    assert pbd.measure(sim).max_stretch > 100.0
    assert "left the finite numbers" in failure(sim)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_the_energy_limit_is_above_the_start(dtype):
    """Free fall keeps its energy but for the first-order term h g v / 2; a push from outside does not."""
    builder = pbd.ModelBuilder()
    builder.add_particles(np.linspace([0, 0, 0], [1, 0, 0], 200), (0, 1, 0), mass=0.5)
    sim = pbd.Simulation(builder.finalize(dtype=dtype), limits=pbd.Limits(energy=50.0))
    for _ in range(10):
        sim.step()
    v = state(sim)[1]
    v[150] = (20.0, 0, 0)  # 0.5 * 0.5 kg * 400 m^2/s^2 = 100 J
    sim.state.v.assign(v)
    assert "frame 11 (t = 0.183333 s): energy rose beyond the limit of 50 J" in failure(sim, 1)


@pytest.mark.parametrize("limits", [{"stretch": 0.0}, {"energy": -1.0}, {"stretch": float("nan")}])
def test_limits_are_checked(limits):
    with pytest.raises(pbd.InputError, match="limit of"):
        pbd.Limits(**limits)


def test_a_scene_without_distances_and_limits_launches_no_monitor():
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 0, 0))
    sim = pbd.Simulation(builder.finalize())
    with sim._context.launch.dry_run() as trace:
        sim._loop.monitor.launch()
    assert trace == []


# Newton's method that does not converge.


def whip(**settings):
    """50 links fall from the horizontal: at one "midpoint" step a frame Newton's method soon finds nothing."""
    return pbd.Simulation(rope_model(51), method=pbd.Direct(), integrator="midpoint", **settings)


def test_newton_that_does_not_converge_is_an_error():
    message = failure(whip(), 120)
    assert "Newton's method did not converge in 1 solution with Direct" in message
    assert message.endswith("use integrator 'bdf2', or more substeps")


@pytest.mark.parametrize("on_failure", ["subdivide", "fallback"])
def test_a_retry_is_what_its_settings_would_have_made(on_failure):
    sim = whip(on_failure=on_failure)
    other_settings = (
        [{"substeps": 2**k} for k in range(1, 5)]
        if on_failure == "subdivide"
        else [{"integrator": "bdf2"}, {"integrator": "pbd"}]
    )
    for _ in range(100):
        before = state(sim)
        retried = sim.retried
        sim.step()
        assert pbd.measure(sim).max_stretch < 1e-9, "a link that Newton's method gave up is not convergence"
        if sim.retried == retried:
            continue
        expected = None
        for changes in other_settings:
            other = whip().like(**changes)
            other.state.x.assign(before[0])
            other.state.v.assign(before[1])
            try:
                other.step()
            except pbd.SimulationFailed:
                continue
            expected = state(other)
            break
        assert expected is not None
        for a, b in zip(state(sim), expected, strict=True):
            np.testing.assert_array_equal(a, b)
    assert sim.retried >= 1
    assert sim.frame == 100


def test_a_whip_in_too_long_steps_keeps_its_energy_where_frames_are_subdivided():
    sim = whip(on_failure="subdivide")
    for _ in range(240):
        sim.step()
    assert sim.retried > 10
    assert abs(pbd.measure(sim).energy) < 1e-10  # of some 4.9 J that go to and fro


def test_a_retry_leads_the_grabbed_particle_to_its_target():
    sim = pbd.Simulation(rope_model(9), method=pbd.Direct(iterations=4), on_failure="subdivide")
    for _ in range(10):
        sim.step()
    sim.grab(8)
    start, before = state(sim)[0][8], sim.retried
    for k in range(1, 11):
        target = (1.0 - 0.01 * k) * start + (0.0, 0.0, 0.02 * k)
        sim.move_to(target)
        sim.step()
        np.testing.assert_allclose(state(sim)[0][8], target, atol=1e-14)
    assert sim.retried > before
    assert sim.held == 8
    assert sim.unconverged == 0


def test_when_nothing_helps_the_error_says_what_was_tried():
    sim = pbd.Simulation(rope_model(6), method=pbd.Direct(1), on_failure="subdivide")
    sim.grab(5)
    sim.move_to((2.0, 0.0, 0.0))
    message = failure(sim, 1)
    assert "particles 0 and 5 are held 2 m apart, on a rope of 1 m: hold them nearer to each other" in message
    assert message.endswith("tried without success: 2 substeps, 4 substeps, 8 substeps, 16 substeps")


def test_fallback_from_the_most_robust_has_nothing_left():
    sim = pbd.Simulation(rope_model(6), method=pbd.Direct(1), on_failure="fallback")
    sim.grab(5)
    sim.move_to((2.0, 0.0, 0.0))
    assert failure(sim, 1).endswith("tried without success: nothing more robust than 'pbd'")


def test_unknown_on_failure():
    with pytest.raises(pbd.InputError, match="unknown on_failure 'fall-back'"):
        pbd.Simulation(rope_model(3), on_failure="fall-back")


# Depenetration speed.

SPEED = 0.5


@pytest.mark.parametrize("substeps", [1, 8])
@pytest.mark.parametrize("method", [pbd.Jacobi(), pbd.GaussSeidel(), pbd.Direct()])
@pytest.mark.parametrize("apart", [0.4, 1.8])
def test_a_link_pulled_or_pushed_and_let_go_recovers_at_the_speed(method, substeps, apart):
    model = pair(apart, 1.0)
    free, limited = (
        pbd.Simulation(model, substeps=substeps, method=method, depenetration_speed=speed) for speed in (None, SPEED)
    )
    free.step()
    assert pbd.measure(free).max_stretch < 1e-12, "without the limit it is all taken back at once"
    lengths = [apart]
    for _ in range(20):
        limited.step()
        x, v = state(limited)
        lengths.append(np.linalg.norm(x[1] - x[0]))
        np.testing.assert_allclose(np.linalg.norm(v[1] - v[0]), SPEED, rtol=1e-9)
    np.testing.assert_allclose(np.abs(np.diff(lengths)), SPEED * H, rtol=1e-9)
    assert abs(lengths[-1] - 1.0) < abs(apart - 1.0)


@pytest.mark.parametrize("method", [pbd.Jacobi(), pbd.GaussSeidel(), pbd.Direct()])
def test_the_speed_leaves_springs_their_force(method):
    """A spring of 1 / 0.05 N/m that carries 1 kg: a rest length apart from where it hangs, and no error to recover."""
    builder = pbd.ModelBuilder()
    builder.add_particles([(0, 0, 0), (0, -1.0 - 0.05 * 9.81, 0)], mass=[0.0, 1.0])
    builder.add_distance(0, 1, 1.0, compliance=0.05)
    sim = pbd.Simulation(builder.finalize(dtype="float64"), substeps=4, method=method, depenetration_speed=SPEED)
    for _ in range(60):
        sim.step()
    np.testing.assert_allclose(state(sim)[0][1, 1], -1.0 - 0.05 * 9.81, atol=1e-9)


@pytest.mark.parametrize("integrator", ["bdf2", "midpoint", "midpoint4"])
def test_integrators_of_second_order_refuse_the_speed(integrator):
    with pytest.raises(pbd.InputError, match="does not model a depenetration speed"):
        pbd.Simulation(pair(), integrator=integrator, depenetration_speed=SPEED)


def test_a_speed_too_small_for_what_a_step_stretches_is_said():
    settings = {"substeps": 4, "method": pbd.Jacobi(20)}
    texts = [str(c) for c in pbd.Simulation(rope_model(21), depenetration_speed=0.01, **settings).check()]
    assert any("a depenetration speed of 0.01 m/s does not take back what a step stretches" in text for text in texts)
    assert pbd.Simulation(rope_model(21), depenetration_speed=10.0, **settings).check() == []


def spheres(depth, **kwargs):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (1.0 - depth, 0, 0)], radius=0.5, **kwargs)
    builder.enable_contacts()
    return builder.finalize(dtype="float64")


def test_overlapping_particles_part_at_the_speed():
    depth = 0.3
    free, limited = (pbd.Simulation(spheres(depth), substeps=4, depenetration_speed=speed) for speed in (None, SPEED))
    free.step()
    assert pbd.measure(free).overlap < 1e-12, "unlimited it is gone at once"
    apart = [1.0 - depth]
    for _ in range(60):
        limited.step()
        x, v = state(limited)
        apart.append(x[1, 0] - x[0, 0])
        assert np.linalg.norm(v[1] - v[0]) <= SPEED * (1.0 + 1e-12)
    assert np.all(np.diff(apart) <= SPEED * H * (1.0 + 1e-12))
    np.testing.assert_allclose(apart[10], 1.0 - depth + 10 * SPEED * H, rtol=1e-12)
    np.testing.assert_allclose(apart[-1], 1.0, rtol=1e-12)


@pytest.mark.parametrize("shape", ["plane", "sphere"])
def test_a_particle_released_inside_a_collider_comes_out_at_the_speed(shape):
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particle((0, 0.5, 0), radius=0.1)
    if shape == "plane":
        builder.add_plane((0, 0, 0), (0, 1, 0))
    else:
        builder.add_sphere((0, -2, 0), 2.0)
    sim = pbd.Simulation(builder.finalize(dtype="float64"), substeps=4, depenetration_speed=SPEED)
    sim.grab(0)
    sim.move_to((0, -0.4, 0))
    sim.step()
    sim.move_to((0, -0.4, 0))
    sim.step()
    sim.release()
    heights = [-0.4]
    for _ in range(90):
        sim.step()
        heights.append(state(sim)[0][0, 1])
    assert np.diff(heights).max() <= SPEED * H * (1.0 + 1e-9)
    np.testing.assert_allclose(heights[20] - heights[10], 10 * SPEED * H, rtol=1e-9)
    np.testing.assert_allclose(heights[-1], 0.1, atol=1e-9)


def test_the_speed_does_not_hold_back_an_ordinary_contact():
    """What flies in is stopped in the same step, at any speed."""
    results = []
    for speed in (None, SPEED):
        builder = pbd.ModelBuilder(gravity=(0, 0, 0))
        builder.add_particles([(0, 0, 0), (3, 0, 0)], [(30, 0, 0), (0, 0, 0)], radius=0.5)
        builder.enable_contacts()
        sim = pbd.Simulation(builder.finalize(dtype="float64"), depenetration_speed=speed)
        for _ in range(20):
            sim.step()
        results.append(state(sim)[0])
    np.testing.assert_array_equal(*results)


# What is known to fail, before the first step.


def named_by(sim):
    return [warning.test for warning in sim.check()]


KNOWN_TO_FAIL = {
    "relaxation": lambda: pbd.Simulation(star(8), method=pbd.Jacobi(averaging="none")),
    "sweeps": lambda: pbd.Simulation(rope_model(9), method=pbd.Jacobi(1, relaxation=1.4)),
    "mass_ratio": lambda: pbd.Simulation(rope_model(4, mass=[1.0, 1.0, 1.0, 1e4]), method=pbd.Jacobi(20)),
    "chain_length": lambda: pbd.Simulation(rope_model(51), method=pbd.Jacobi(20)),
    "step": lambda: whip(),
    "precision": lambda: pbd.Simulation(far(1e4), method=pbd.Direct()),
    "unreachable": lambda: pbd.Simulation(held_apart(1.1), method=pbd.Direct()),
    "speed": lambda: pbd.Simulation(spheres(0.0, velocity=(0, 0, 100.0))),
}

CURED = {
    "relaxation": lambda: pbd.Simulation(star(8), method=pbd.Jacobi()),
    "sweeps": lambda: pbd.Simulation(rope_model(9), method=pbd.Jacobi(2, relaxation=1.4)),
    "mass_ratio": lambda: pbd.Simulation(rope_model(4, mass=[1.0, 1.0, 1.0, 1e4]), method=pbd.Direct()),
    "chain_length": lambda: pbd.Simulation(rope_model(51), substeps=64, method=pbd.Jacobi(2)),
    "step": lambda: whip(substeps=4),
    "precision": lambda: pbd.Simulation(far(1e4, "float64"), method=pbd.Direct()),
    "unreachable": lambda: pbd.Simulation(held_apart(0.9), method=pbd.Direct()),
    "speed": lambda: pbd.Simulation(spheres(0.0, velocity=(0, 0, 100.0)), substeps=16),
}


def far(distance, dtype="float32"):
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([distance, 0, 0], [distance + 1, 0, 0], 11))
    return builder.finalize(dtype=dtype)


def held_apart(factor):
    builder = pbd.ModelBuilder()
    x = np.linspace([0, 0, 0], [1, 0, 0], 6)
    ends = builder.add_particles(x * factor, mass=[0.0, 1, 1, 1, 1, 0.0])
    builder.add_distances([(i, i + 1) for i in ends[:-1]], rest_length=0.2)
    return builder.finalize()


@pytest.mark.parametrize("name", KNOWN_TO_FAIL)
def test_what_is_known_to_fail_is_said_and_its_cure_is_not(name):
    warning = next(c for c in KNOWN_TO_FAIL[name]().check() if c.test == name)
    assert warning.severity > 1.0
    assert str(warning).endswith(f"(test: {name})")
    assert warning.remedy in str(warning)
    assert name not in named_by(CURED[name]())


def test_a_link_between_two_fixed_particles_is_no_warning():
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0, 0, 0], [1, 0, 0], 5), pinned=(0, 1))
    assert pbd.Simulation(builder.finalize(), method=pbd.Direct()).check() == []


@pytest.mark.parametrize("spokes", [3, 5, 8, 16])
@pytest.mark.parametrize("averaging", ["none", "valence", "mass-splitting"])
def test_the_power_iteration_finds_the_largest_eigenvalue(spokes, averaging):
    """Of the dense matrix J W J^T over what the method divides by."""
    from pbd_warp.step.methods.spectrum import JacobiSweep

    model = star(spokes, "float64")
    hub = spokes if averaging == "mass-splitting" else 1.0
    moved = spokes if averaging == "valence" else 1.0  # the hub's correction is divided by this
    n = model.x[1:] / 1.01
    a = n @ n.T / moved + np.eye(spokes)
    expected = np.linalg.eigvals(a / (hub + 1.0)).real.max()
    valence = pbd.Jacobi().valence(model)
    assert abs(JacobiSweep(model, averaging, valence).largest_eigenvalue() - expected) < 1e-6 * expected
