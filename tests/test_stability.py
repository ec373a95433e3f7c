"""Where methods fail, and that the cure holds there: both sides of each boundary, each by itself in a scene."""

import numpy as np
import pytest
from models import state

import pbd_warp as pbd
from pbd_warp.stability import theory
from pbd_warp.stability.cell import run_scene, study
from pbd_warp.stability.classify import classify
from pbd_warp.stability.contact_maps import sampled_bullets
from pbd_warp.stability.solver_maps import alternating_chain
from pbd_warp.stability.step_maps import textbook_pendulum


def run(scene, dtype="float64", frames=None):
    """A scene's simulation after its frames, and the measures of each."""
    sim = pbd.Simulation(scene.builder.finalize("cpu", dtype), scene.settings)
    drag = pbd.Drag(scene.drag)
    measures = []
    for _ in range(frames or scene.frames):
        drag.advance(sim)
        sim.step()
        measures.append(pbd.measure(sim))
    return sim, measures


def stretch(scene):
    """The largest of a run."""
    return max(now.max_stretch for now in run(scene)[1])


# Jacobi's sweeps: the plain sum, and mass splitting.

VIOLATED = {
    "a star of 16 in the plane": study("star", spokes=16, shape="planar"),
    "a star of 16 in space": study("star", spokes=16, shape="space"),
    "a star of 16 on a line": study("star", spokes=16, shape="line"),
    "a bar given three times": study("overconstrained", copies=3, sides=1),
    "a triangle given three times": study("overconstrained", copies=3, sides=3, misfit=0.0),
}


@pytest.mark.parametrize("name", VIOLATED)
def test_the_plain_sum_explodes_and_mass_splitting_converges(name):
    scene = VIOLATED[name].changed(frames=20)
    summed = run_scene(scene.changed(method=pbd.Jacobi(20, averaging="none")))
    assert not summed.finite or summed.left > 10.0
    split = run_scene(scene.changed(method=pbd.Jacobi(20)))
    assert split.left < 0.01


@pytest.mark.parametrize(
    ("shape", "most"), [("planar", 6), ("space", 9), ("line", 3)], ids=["in the plane", "in space", "on a line"]
)
def test_how_many_spokes_the_plain_sum_can_take(shape, most):
    """`most` is the last that does not grow: one spoke less converges, one more explodes."""
    assert theory.star_limit(most, shape) == pytest.approx(1.0)

    def left(spokes):
        scene = study("star", spokes=spokes, shape=shape)
        return run_scene(scene.changed(frames=20, method=pbd.Jacobi(20, averaging="none"))).left

    # The star of two spokes on a line is a chain of two links, whose limit is 4/3 too.
    assert left(most - 1) < 0.1
    assert left(most + 1) > 10.0


def test_a_bar_given_twice_never_converges_and_never_explodes():
    scene = study("overconstrained", copies=2, sides=1).changed(frames=20)
    _, measures = run(scene.changed(method=pbd.Jacobi(20, averaging="none")))
    assert [now.residual for now in measures] == pytest.approx([0.03] * 20, abs=1e-9)
    # An odd number of sweeps leaves it as far on the other side.
    _, measures = run(scene.changed(method=pbd.Jacobi(19, averaging="none")), frames=1)
    assert measures[0].residual == pytest.approx(0.03, abs=1e-9)
    assert run(scene.changed(method=pbd.Jacobi(20)))[1][-1].residual < 1e-9


@pytest.mark.parametrize(("averaging", "holds", "fails"), [("none", 0.95, 1.05), ("valence", 1.9, 2.1)])
def test_how_much_relaxation_a_chain_can_take(averaging, holds, fails):
    def left(relaxation, averaging=averaging):
        method = pbd.Jacobi(20, relaxation=relaxation, averaging=averaging)
        return run_scene(alternating_chain(32).changed(frames=20, method=method)).left

    assert left(holds) < 0.1
    assert left(fails) > 10.0
    assert left(1.9, "mass-splitting") < 0.1
    with pytest.raises(pbd.InputError, match=r"relaxation must be in \(0, 2\)"):
        left(2.0, "mass-splitting")


@pytest.mark.parametrize(("iterations", "holds", "fails"), [(1, 1.3, 1.4), (3, 1.65, 1.8), (5, 1.75, 1.9)])
def test_an_odd_number_of_sweeps_takes_less_relaxation(iterations, holds, fails):
    """Every sweep by itself contracts up to 2; what it leaves comes back with the velocity."""
    assert holds < theory.sweeps_limit(iterations) < fails

    def left(iterations, relaxation):
        scene = alternating_chain(6).changed(frames=400 // iterations)
        return run_scene(scene.changed(method=pbd.Jacobi(iterations, relaxation=relaxation))).left

    assert left(iterations, holds) < 0.1
    assert left(iterations, fails) > 10.0
    assert left(iterations + 1, fails) < 0.1


def test_a_loop_that_cannot_close_rests_and_shares_what_is_too_much():
    """Three copies of a triangle with sides 1, 1 and 2.4: two ends apart by more than the others can reach."""
    scene = study("overconstrained", copies=3, sides=3, misfit=0.2)
    sim, _ = run(scene)
    x, v = state(sim)
    assert np.abs(v).max() < 1e-3
    side = np.linalg.norm(np.roll(x, -1, axis=0) - x, axis=1)
    off = side - [1.0, 1.0, 2.4]
    # Flat, so side 3 is the sum of the others; split masses leave equal errors: 1 + a + 1 + a = 2.4 - a.
    np.testing.assert_allclose(off, [0.4 / 3, 0.4 / 3, -0.4 / 3], atol=1e-3)


# Length and mass ratio.


@pytest.mark.parametrize("method", [pbd.Jacobi, pbd.GaussSeidel])
@pytest.mark.parametrize(("links", "iterations", "substeps"), [(10, 20, 1), (10, 1, 8), (30, 20, 1), (30, 1, 16)])
def test_a_hanging_rope_sags_by_what_the_sweeps_leave(method, links, iterations, substeps):
    scene = study("long_rope", links=links)
    _, measures = run(scene.changed(substeps=substeps, method=method(iterations)), frames=1200)
    step = 1.0 / (60.0 * substeps)
    sag = theory.sag(theory.rope_masses(links), iterations, step, method.name)
    assert measures[-1].max_stretch == pytest.approx(sag, rel=3e-3)  # it swings a little yet


def test_jacobi_cannot_carry_many_links_and_substeps_or_direct_can():
    """At 60 Hz, falling from the horizontal for a second."""

    def falling(links, method, substeps=1):
        scene = study("whip", links=links)
        return stretch(scene.changed(frames=60, integrator="pbd", substeps=substeps, method=method))

    assert 0.05 < falling(10, pbd.Jacobi(20)) < 0.15
    assert 2.0 < falling(50, pbd.Jacobi(20)) < 4.0
    assert falling(10, pbd.Jacobi(1), substeps=64) < 0.002
    assert falling(50, pbd.Jacobi(1), substeps=64) < 0.07
    assert falling(50, pbd.Direct()) < 1e-10


def test_a_bob_of_100000_times_the_mass_needs_direct_or_many_substeps():
    """100 iterations let it fall to several times the length; 1024 substeps hold it."""
    scene = study("heavy_bob", ratio=1e5).changed(frames=42, integrator="pbd")
    for method in (pbd.Jacobi(100), pbd.GaussSeidel(100)):
        assert stretch(scene.changed(substeps=1, method=method)) > 1.0
    needed = theory.sweeps_for(theory.heavy_bob(1e5, 20), 1.0 / 60.0, "gauss-seidel", 3.0, steps=True)
    assert 256 < needed < 1024
    assert stretch(scene.changed(substeps=1024, method=pbd.GaussSeidel(1))) < 0.1
    sim, measures = run(scene.changed(substeps=1, method=pbd.Direct()))
    assert max(now.max_stretch for now in measures) < 1e-6
    assert state(sim)[0][-1, 1] < -0.5, "it has not swung"


@pytest.mark.parametrize("rho", [0.9999, 0.99999])
def test_chebyshev_explodes_when_told_too_large_a_radius(rho):
    scene = study("whip", links=32).changed(frames=60, integrator="pbd")

    def cell(chebyshev):
        return run_scene(scene.changed(method=pbd.Jacobi(100, chebyshev=chebyshev)))

    assert classify(cell(rho)) in ("gained energy", "not finite")
    plain, accelerated = cell(None), cell(0.99)
    assert classify(plain) == "stretched"
    assert classify(accelerated) == "converged"
    assert accelerated.stretch < 0.5 * plain.stretch


# The step.


@pytest.mark.parametrize("integrator", ["midpoint", "midpoint4"])
@pytest.mark.parametrize(("links", "fps"), [(100, 5.0), (200, 10.0)])
def test_midpoint_says_where_it_finds_no_solution_in_long_steps_and_bdf2_and_short_steps_hold(integrator, links, fps):
    """Direct then leaves as little stretch as it can and adds no energy, but says of those steps that it failed."""

    def whip(fps, integrator):
        return study("whip", links=links, fps=fps).changed(frames=round(fps), integrator=integrator)

    def cell(fps, integrator):
        return run_scene(whip(fps, integrator))

    scene = whip(fps, integrator)
    sim = pbd.Simulation(scene.builder.finalize(dtype="float64"), scene.settings, on_failure="continue")
    unconverged = 0
    for _ in range(scene.frames):
        sim.step()
        unconverged += sim.unconverged
    assert (unconverged > 0) == ((links, integrator) != (100, "midpoint"))
    assert unconverged or pbd.measure(sim).max_stretch < 1e-12
    for held in (cell(fps, "bdf2"), cell(240.0, integrator)):
        assert classify(held) == "converged"
        assert held.stretch < 1e-9


# Precision.


def bob(distance, rate, dtype):
    """Of the scene far_away after a second, from the pin."""
    scene = study("far_away", distance=distance).changed(frames=60, substeps=rate // 60)
    x, _ = state(run(scene, dtype)[0])
    return x[1] - x[0]


def test_far_from_the_origin_displacements_move_on_where_positions_freeze():
    """1000 m away in steps of 1/3840 s, gravity moves a particle by 7e-7 m a step; float32 has 6e-5 m there."""
    exact = bob(0.0, 3840, "float64")
    assert exact[0] < -0.5, "it has not swung to the other side"
    frozen = textbook_pendulum(1000.0, 3840, np.float32)
    np.testing.assert_array_equal(frozen, [1.0, 0.0])
    np.testing.assert_allclose(bob(1000.0, 3840, "float32"), exact, atol=0.01)
    # The textbook's formula itself is right: in float64, and near the origin in long steps.
    np.testing.assert_allclose(textbook_pendulum(1000.0, 3840, np.float64), exact[:2], atol=1e-6)
    np.testing.assert_allclose(textbook_pendulum(1.0, 240, np.float32), bob(0.0, 240, "float64")[:2], atol=0.01)


def test_further_away_still_float64_moves_on_where_float32_cannot_store_the_positions():
    exact = bob(0.0, 960, "float64")
    assert exact[0] < -0.5, "it has not swung to the other side"
    assert np.abs(bob(1e6, 960, "float32") - exact).max() > 0.01
    np.testing.assert_allclose(bob(1e6, 960, "float64"), exact, atol=1e-6)


# Contacts.


@pytest.mark.parametrize("speed", [11.0, 16.0, 100.0, 1000.0])
def test_a_bullet_is_stopped_where_a_test_at_the_ends_of_steps_misses_it(speed):
    """Above both diameters a step, which is 12 m/s here; it would do with two steps up to 24 m/s."""
    limit = theory.sampled_speed(60.0, 0.1)
    assert sampled_bullets(speed, steps=1) == (speed > limit)
    assert sampled_bullets(speed, steps=2) == (speed > 2.0 * limit)
    sim, _ = run(study("bullet", speed=speed).changed(frames=6), "float32")
    x, v = state(sim)
    shot = sim.model.v[:, 0] > 0.0
    # At its post, not before it and not behind it; a float32 position a step's way back is rounded.
    np.testing.assert_allclose(x[shot, 0], -0.1, atol=1e-4)
    np.testing.assert_allclose(v, 0.0, atol=1e-3 * speed)


def test_a_bullet_faster_than_float32_can_sweep_is_stopped_in_float64_and_in_shorter_steps():
    def outcome(dtype, substeps):
        scene = study("bullet", speed=1e5).changed(frames=6, substeps=substeps)
        return classify(run_scene(scene, dtype, in_line=True))

    assert outcome("float32", 1) == "missed"
    assert outcome("float64", 1) == outcome("float32", 16) == "converged"


@pytest.mark.parametrize("substeps", [1, 4])
def test_three_discs_inside_each_other_leave_with_a_quarter_of_depth_over_step_and_two_do_not(substeps):
    depth, step = 0.2, 1.0 / (60.0 * substeps)

    def fastest(discs):
        scene = study("deep_overlap", depth=depth, discs=discs)
        sim, measures = run(scene.changed(frames=12, substeps=substeps, method=pbd.Jacobi(60)))
        assert measures[-1].overlap < 1e-6
        x, v = state(sim)
        apart = np.linalg.norm(x[0] - x[1])
        assert apart >= 0.2 - 1e-6, "still inside each other"
        return np.linalg.norm(v, axis=1).max()

    assert fastest(2) < 1e-9
    assert fastest(3) == pytest.approx(0.25 * (0.2 * depth / np.sqrt(3.0)) / step, rel=0.02)


@pytest.mark.parametrize("balls", [3, 5, 8])
def test_a_cradle_needs_gaps(balls):
    def velocities(gap):
        sim, _ = run(study("cradle", balls=balls, gap=gap).changed(frames=60))
        return state(sim)[1][:, 0]

    np.testing.assert_allclose(velocities(0.02), np.eye(balls)[-1], atol=1e-9)
    touching = velocities(0.0)
    assert touching[-1] < 0.99, "it would be the exact cradle"
    assert touching.sum() == pytest.approx(1.0, abs=1e-9)


# What starts or stays violated.


def test_a_rope_pulled_too_far_is_stretched_evenly():
    """By Jacobi evenly but for the links at the ends, where one particle is not free: half as much."""

    def held(factor, method):
        scene = study("stretched", factor=factor, links=10).changed(frames=59, damping=0.0, method=method)
        return run(scene)[1][30:]  # from when the grabber has arrived

    assert [now.max_stretch for now in held(1.5, pbd.Jacobi(20))] == pytest.approx([0.5 * 10 / 9] * 29, rel=1e-3)
    assert [now.max_stretch for now in held(1.5, pbd.Direct())] == pytest.approx([0.5] * 29, rel=1e-6)
    # Within its length both hold.
    for method in (pbd.Jacobi(20), pbd.Direct()):
        assert max(now.max_stretch for now in held(1.0, method)) < 1e-9


def test_a_rope_pulled_too_far_comes_back_when_it_is_let_go():
    scene = study("stretched", factor=1.5)
    sim, measures = run(scene)
    assert max(now.max_stretch for now in measures) > 0.49
    assert measures[-1].max_stretch < 0.01
    x, v = state(sim)
    assert np.abs(v).max() < 1.0
    assert np.linalg.norm(x[-1] - x[0]) < 1.01


@pytest.mark.parametrize("joined", [1, 0], ids=["chain", "discs"])
def test_particles_in_one_place_part(joined):
    sim, _ = run(study("coincident", count=8, joined=joined))
    x, _ = state(sim)
    apart = np.linalg.norm(x[:, None] - x, axis=2)
    if joined:
        np.testing.assert_allclose(np.diag(apart, 1), 0.1, atol=1e-3)
    else:
        assert apart[np.triu_indices(8, 1)].min() > 0.1 - 1e-3
    # One sweep a step is too few for 32 of them.
    scene = study("coincident", count=32, joined=joined)
    assert run_scene(scene.changed(frames=30, method=pbd.Jacobi(1)), energy=False).stretch > 0.1
    assert run_scene(scene.changed(frames=30, method=pbd.Jacobi(64)), energy=False).stretch < 0.1
