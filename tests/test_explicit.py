"""The explicit integrator of order 8: against the differential equations, in float64."""

import numpy as np
import pytest
from explicit import DT, explicit, motion, step, where
from models import state
from solving import both_precisions

import pbd_warp as pbd
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.settings import Settings
from pbd_warp.step.integrators import pieces


def graph(x, edges, fixed=(), mass=1.0, v=None, rest=None, compliance=0.0, points=(), dtype="float64"):
    builder = pbd.ModelBuilder()
    masses = np.broadcast_to(mass, len(x)).astype(float)
    masses[list(fixed)] = 0.0
    builder.add_particles(x, np.zeros((len(x), 3)) if v is None else v, masses)
    builder.add_distances(edges, rest, compliance=compliance)
    for particle in points:
        builder.add_point(particle, x[particle])
    return builder.finalize(dtype=dtype)


def straight(links, dtype="float64"):
    """A metre, a kilogram, from the horizontal."""
    x = np.linspace([0.0, 0, 0], [1.0, 0, 0], links + 1)
    return graph(x, [(k, k + 1) for k in range(links)], fixed=[0], mass=1.0 / links, dtype=dtype)


def net(columns, rows):
    """Waves on a square net, 1 m a link or a bit more."""
    i, j = np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij")
    x = np.stack([i, 0.1 * np.sin(2.0 * i + j), j], axis=-1).reshape(-1, 3)
    number = np.arange(columns * rows).reshape(columns, rows)
    along = np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1)
    across = np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1)
    return x, np.concatenate([along, across]).tolist()


def cases():
    rng = np.random.default_rng(3)
    t = 2.0 * np.pi * np.arange(8) / 8
    ring, around = np.stack([np.cos(t), np.sin(t), 0.3 * np.cos(2.0 * t)], axis=1), [(k, (k + 1) % 8) for k in range(8)]
    crooked, row = np.cumsum(rng.normal(size=(7, 3)), axis=0), [(k, k + 1) for k in range(6)]
    star, body = rng.normal(size=(7, 3)), rng.normal(size=(5, 3))
    tree = rng.normal(size=(13, 3))
    third = np.where(np.arange(24) % 3 == 0, 1e-3, 0.0)
    return {
        "path": graph(crooked, row, fixed=[0], mass=rng.uniform(0.5, 2.0, 7)),
        "path, backwards and shuffled": graph(
            crooked[[3, 1, 6, 0, 2, 5, 4]], [(1, 3), (4, 1), (0, 4), (6, 0), (5, 6), (2, 5)]
        ),
        "path, mass ratio 1e6": graph(crooked, row, fixed=[0], mass=[0, 1, 1e-3, 1, 1e3, 1, 1]),
        "path, held inside": graph(crooked, row, fixed=[2, 3], points=[6]),
        "path, springs": graph(crooked, row, fixed=[0], compliance=[0, 0, 1e-2, 0, 1e-2, 0]),
        "springs only": graph(crooked, row, fixed=[0], compliance=1e-2),
        "two pieces, one a single particle": graph(
            np.vstack([crooked, [9, 9, 9]]), row, v=[*np.zeros((7, 3)), (1, 2, 3)]
        ),
        "loop": graph(ring, around, fixed=[0]),
        "star": graph(star, [(0, k) for k in range(1, 7)], mass=rng.uniform(0.5, 2.0, 7)),
        "tree": graph(tree, [((k - 1) // 3, k) for k in range(1, 13)], fixed=[5]),
        "net": graph(*net(4, 4), fixed=[0, 3]),
        "net, springs": graph(*net(4, 4), fixed=[0, 3], compliance=third),
        "links given twice and thrice": graph(ring, [*around, (2, 3), (3, 2), (5, 6)], fixed=[0]),
        "rigid body of redundant links": graph(
            body, [(a, b) for a in range(5) for b in range(a)], v=np.cross([1.0, 2.0, 3.0], body)
        ),
    }  # fmt: skip


CASES = cases()


@pytest.mark.parametrize("case", CASES)
def test_graphs_move_as_their_differential_equations(case):
    model = CASES[case]
    expected, expected_v = motion(model, 0.25, led=model.point.particle, velocity=0.0)
    x, v = state(explicit(model, 15, error=1e-10))
    assert np.abs(x - expected).max() < 1e-11
    assert np.abs(v - expected_v).max() < 1e-10
    rigid = model.distance.compliance == 0.0
    assert np.abs(model.distance.residual(x))[rigid].max(initial=0.0) < 2e-15


def test_a_path_moves_the_same_by_either_elimination(monkeypatch):
    model = CASES["path, springs"]
    along = explicit(model, 10, substeps=3)
    of = pieces.Pieces.of

    def no_path(count, edge):
        p = of(count, edge)
        nowhere = np.full_like(p.link, -1)
        return pieces.Pieces(p.first, p.end, p.vertex, ~p.is_path, nowhere, {0: np.arange(len(edge), dtype=np.int32)})

    monkeypatch.setattr(pieces.Pieces, "of", no_path)
    general = explicit(model, 10, substeps=3)
    np.testing.assert_allclose(where(general), where(along), rtol=0, atol=1e-13)


@pytest.mark.parametrize(("integrator", "order", "substeps"), [("dop853", 8, (1, 2, 4)), ("rk4", 4, (4, 8, 16))])
def test_order(integrator, order, substeps):
    """Of positions and velocities, before round-off: 10 links fall for a quarter of a second."""
    model = straight(10)
    expected = motion(model, 0.25)
    runs = [state(explicit(model, 6, dt=0.25 / 6, substeps=s, integrator=integrator)) for s in substeps]
    for kind in (0, 1):
        error = [np.abs(run[kind] - expected[kind]).max() for run in runs]
        assert abs(-np.polyfit(np.log(substeps), np.log(error), 1)[0] - order) < 0.5


def test_energy_of_ten_links_for_twenty_seconds():
    """Through every crack of the whip, within 1e-8 of its range."""
    model = straight(10)
    mass = np.where(model.w > 0.0, 0.1, 0.0)
    sim = explicit(model, error=1e-9)
    energies = []
    for _ in range(1200):
        sim.step()
        x, v = state(sim)
        energies.append(mass @ (0.5 * np.sum(v**2, axis=1) + 9.81 * x[:, 1]))
    reach = 2.0 * 9.81 * mass @ np.linspace(0.0, 1.0, 11)  # from straight up to straight down
    assert np.abs(energies).max() < 1e-8 * reach


@pytest.mark.parametrize("how", ["grabbed", "led", "point"])
def test_a_particle_is_moved_evenly_over_the_frame(how):
    """The others follow at once, as the equations with a prescribed motion have it."""
    x = np.cumsum(np.random.default_rng(5).normal(size=(5, 3)), axis=0)
    fixed = [2] if how == "led" else []
    model = graph(x, [(k, k + 1) for k in range(4)], fixed=fixed, points=[2] if how == "point" else ())
    velocity = np.array([0.3, -0.2, 0.5])
    sim = explicit(model, error=1e-10)
    if how == "grabbed":
        sim.grab(2)
    for frame in range(1, 4):
        target = x[2] + velocity * DT * frame
        if how == "grabbed":
            sim.move_to(target)
        elif how == "led":
            sim.lead([2], target[None])
        else:
            sim.point_target.assign(target[None])
        sim.step()
    expected, expected_v = motion(model, 3 * DT, led=[2], velocity=velocity)
    np.testing.assert_allclose(where(sim), expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(state(sim)[1], expected_v, rtol=0, atol=1e-10)


def test_what_is_let_go_flies_on():
    model = CASES["path"]
    sim = explicit(model, error=1e-10)
    sim.grab(6)
    x = where(sim)[6]
    sim.move_to(x + np.array([0.01, 0.0, 0.0]))
    sim.step()
    sim.release()
    sim.step()
    assert np.linalg.norm(where(sim)[6] - x) > 0.01
    assert np.abs(model.distance.residual(where(sim))).max() < 2e-15


@both_precisions
def test_both_precisions(dtype):
    x = where(explicit(straight(10, dtype), 30, error=1e-5))
    assert np.abs(x - motion(straight(10), 0.5)[0]).max() < {"float32": 5e-5, "float64": 5e-6}[dtype]


def test_steps_are_each_pieces_own():
    """A whip beside a single particle: the particle takes one step a frame."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], 11), pinned=(0,))
    builder.add_particles([[5.0, 0, 0]], [[0.0, 0, 0]], [1.0])
    sim = explicit(builder.finalize(dtype="float64"), 20, error=1e-9)
    assert sorted(sim._loop.explicit.steps_used) == [1, sim.substeps_used]
    assert sim.substeps_used > 1


@pytest.mark.parametrize("settings", [{"error": 1e-6}, {"substeps": 4}])
@pytest.mark.parametrize("case", ["held too far apart", "contradictory"])
def test_what_nothing_satisfies_is_told(case, settings):
    """The state stays finite, and nothing runs for ever."""
    x, row = np.linspace([0.0, 0, 0], [1.0, 0, 0], 6), [(k, k + 1) for k in range(5)]
    if case == "held too far apart":
        model = graph(x, row, fixed=[0, 5], rest=0.19)
    else:
        model = graph(x, [*row, (1, 2)], fixed=[0], rest=[0.2] * 5 + [0.21])
    sim = explicit(model, **settings)
    with pytest.raises(SimulationFailed, match=r"joined to particle 0 keep their lengths.*compliance"):
        sim.step()
    assert np.isfinite(state(sim)).all()
    assert sim.substeps_used < 100


def test_not_a_number_is_told():
    sim = explicit(straight(3), substeps=2)
    sim.state.v[2:3].fill_(np.nan)
    with pytest.raises(SimulationFailed, match="frame 1"):
        sim.step()


def test_a_rope_taut_between_two_points():
    """Its tension is infinite, and one link too many holds it: steps of equal length are refused their frame, short
    ones keep it straight."""
    x = np.linspace([0.0, 0, 0], [1.0, 0, 0], 6)
    model = graph(x, [(k, k + 1) for k in range(5)], fixed=[0, 5])
    with pytest.raises(SimulationFailed):
        explicit(model, 1, substeps=4)
    assert np.abs(where(explicit(model, 2, error=1e-3)) - x).max() < 1e-7


def test_a_start_that_is_off_is_put_right():
    """Lengths and tangent, by the least change in the metric of the masses: momentum stays."""
    rng = np.random.default_rng(2)
    x = np.cumsum(rng.normal(size=(6, 3)), axis=0)
    rest = np.linalg.norm(np.diff(x, axis=0), axis=1) * 1.02
    mass = rng.uniform(0.5, 2.0, 6)
    model = graph(x, [(k, k + 1) for k in range(5)], mass=mass, rest=rest, v=rng.normal(size=(6, 3)))
    x, v = state(explicit(model, 1, error=1e-9))
    assert np.abs(model.distance.residual(x)).max() < 1e-14
    fall = mass.sum() * np.asarray(model.gravity) * DT
    np.testing.assert_allclose(mass @ v, mass @ model.v + fall, rtol=0, atol=1e-13)


def test_the_captured_frame_is_the_same_and_one_launch_and_goes_on_from_a_checkpoint(tmp_path):
    model = straight(10)
    replayed, launched = (explicit(model, 20, error=1e-8, capture=capture) for capture in (True, False))
    np.testing.assert_array_equal(where(replayed), where(launched))
    assert replayed.passes == ["make_frame"]
    replayed.save(tmp_path / "checkpoint")
    resumed = pbd.Simulation.load(tmp_path / "checkpoint")
    for sim in (replayed, resumed):
        for _ in range(5):
            sim.step()
    np.testing.assert_array_equal(where(replayed), where(resumed))


@pytest.mark.parametrize("case", ["path", "net", "path, held inside", "two pieces, one a single particle"])
def test_many_frames_in_one_call_are_the_same_frames(case):
    together, apart = explicit(CASES[case], error=1e-8), explicit(CASES[case], 12, error=1e-8)
    together.step(frames=5)
    together.step(frames=7)
    assert together.frame == 12
    for a, b in zip(state(together), state(apart), strict=True):
        np.testing.assert_array_equal(a, b)


def test_what_is_moved_is_moved_in_the_first_of_many_frames():
    together, apart = explicit(CASES["path"], error=1e-8), explicit(CASES["path"], error=1e-8)
    target = where(together)[6] + np.array([0.01, 0.0, 0.0])
    for sim in (together, apart):
        sim.grab(6)
        sim.move_to(target)
    together.step(frames=4)
    step(apart, 4)
    np.testing.assert_array_equal(where(together), where(apart))
    assert np.abs(where(together)[6] - target).max() < 1e-15


def test_many_frames_stop_at_the_one_that_fails():
    """Steps too long for the whip: after some frames its piece fails."""
    apart, together = (explicit(straight(50), substeps=1) for _ in range(2))
    with pytest.raises(SimulationFailed):
        step(apart, 600)
    assert 1 < apart.frame < 600
    with pytest.raises(SimulationFailed, match=f"frame {apart.frame}"):
        together.step(frames=600)
    assert together.frame == apart.frame
    np.testing.assert_array_equal(where(together), where(apart))
    with pytest.raises(InputError, match="frames"):
        together.step(frames=0)


# What it takes and what it refuses.


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf"), "x"])
def test_error_has_to_be_a_length_a_second(bad):
    with pytest.raises(InputError, match="error must be"):
        explicit(straight(3), error=bad)


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"substeps": "auto", "integrator": "midpoint4"}, "estimates its error"),
        ({"substeps": "auto", "integrator": "rk4"}, "estimates its error, dop853; 'rk4' does not"),
        ({"substeps": "many"}, "whole number or 'auto'"),
        ({"substeps": 4, "error": 1e-6}, "substeps='auto'"),
        ({"method": pbd.Direct()}, "takes no method"),
        ({"damping": 0.1}, "damping"),
        ({"depenetration_speed": 1.0}, "depenetration speed"),
        ({"on_failure": "subdivide", "substeps": "auto"}, "number of substeps"),
    ],
)
def test_settings_that_do_not_go_together(settings, match):
    with pytest.raises(InputError, match=match):
        pbd.Simulation(straight(3), **{"integrator": "dop853", **settings})


def test_settings_change_from_and_to_it():
    settings = Settings(method=pbd.Direct(), integrator="midpoint4", substeps=3)
    auto = settings.changed(integrator="dop853", substeps="auto")
    assert (auto.method, auto.error) == (pbd.Jacobi(), 1e-6)
    assert auto.changed(substeps=4).error is None
    assert auto.changed(integrator="bdf2").substeps == 1
    assert auto.changed(integrator="rk4").substeps == 1
    assert settings.changed(integrator="rk4").substeps == 3
    assert Settings.from_json(auto.to_json()) == auto


def refused(what):
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], 3), stiffness=0.5 if what == "stiffness below 1" else 1.0)
    if what == "contacts":
        builder.enable_contacts()
    if what == "colliders":
        builder.add_plane((0, -1, 0), (0, 1, 0))
    if what == "bending":
        builder.add_bending(0, 1, 2, 1e-3)
    if what == "points with compliance":
        builder.add_point(0, (0, 0, 0), compliance=1e-3)
    if what == "one point constraint":
        builder.add_point(0, (0, 0, 0))
        builder.add_point(0, (0, 0, 0))
    return builder.finalize()


@pytest.mark.parametrize(
    "what", ["bending", "contacts", "colliders", "stiffness below 1", "points with compliance", "one point constraint"]
)
def test_what_it_cannot_do_is_refused(what):
    with pytest.raises(InputError, match=what):
        explicit(refused(what))


@pytest.mark.parametrize("integrator", ["dop853", "rk4"])
@pytest.mark.parametrize("too_stiff", [True, False])
def test_a_spring_too_stiff_for_the_step_is_foretold(too_stiff, integrator):
    """On either side of the limit: told and growing, or neither."""
    frequency = {"dop853": 5.9, "rk4": 2.8}[integrator] * (1.05 if too_stiff else 0.95) / DT
    model = graph(np.array([[0.0, 0, 0], [1.0, 0, 0]]), [(0, 1)], fixed=[0], rest=0.9999, compliance=frequency**-2.0)
    sim = explicit(model, substeps=1, integrator=integrator, limits=pbd.Limits(stretch=0.3))
    assert [warning.test for warning in sim.check()] == ["step"] * too_stiff
    if too_stiff:
        with pytest.raises(SimulationFailed, match="too stiff for a step"):
            step(sim, 120)
    else:
        step(sim, 120)
        weights = 3.0 * 9.81 / frequency**2  # of a pendulum that swings through its lowest point
        assert abs(np.linalg.norm(where(sim)[1]) - 0.9999) < weights + 1e-4


def test_an_error_below_rounding_is_foretold():
    assert [w.test for w in explicit(straight(10, "float32"), error=1e-8).check()] == ["precision"]
    assert not explicit(straight(10), error=1e-8).check()
