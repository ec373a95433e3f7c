"""The explicit integrator of order 8: against the differential equations, in float64."""

import numpy as np
import pytest
import warp as wp
from explicit import DT, Frames, motion
from solving import both_precisions

import pbd_warp as pbd
from pbd_warp.accuracy import references
from pbd_warp.errors import InputError
from pbd_warp.kernels import explicit as kernels
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


def random_chain(seed):
    """4 to 13 particles on a bent line of about a metre, links and masses of many sizes, one end fixed."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 13))
    heading = rng.normal(size=3)
    headings = []
    for _ in range(n - 1):
        headings.append(heading / np.linalg.norm(heading))
        heading = headings[-1] + 0.5 * rng.normal(size=3)
    links = np.array(headings) * rng.uniform(0.5, 1.5, (n - 1, 1)) / (n - 1)
    x = np.vstack([np.zeros(3), np.cumsum(links, axis=0)])
    return graph(x, [(k, k + 1) for k in range(n - 1)], fixed=[0], mass=rng.uniform(0.5, 2.0, n) / n)


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
        "two pieces, one a single particle": graph(np.vstack([crooked, [9, 9, 9]]), row, v=[*np.zeros((7, 3)), (1, 2, 3)]),
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
    x, v = motion(model, 0.25, led=model.point.particle, velocity=0.0)
    frames = Frames(model, error=1e-10).step(15)
    assert np.abs(frames.x - x).max() < 1e-11
    assert np.abs(frames.v - v).max() < 1e-10
    rigid = model.distance.compliance == 0.0
    assert np.abs(model.distance.residual(frames.x))[rigid].max(initial=0.0) < 2e-15


def test_a_path_moves_the_same_by_either_elimination(monkeypatch):
    model = CASES["path, springs"]
    along = Frames(model, substeps=3).step(10)
    of = pieces.Pieces.of

    def no_path(count, edge):
        p = of(count, edge)
        nowhere = np.full_like(p.link, -1)
        return pieces.Pieces(p.first, p.end, p.vertex, ~p.is_path, nowhere, {0: np.arange(len(edge), dtype=np.int32)})

    monkeypatch.setattr(pieces.Pieces, "of", no_path)
    general = Frames(model, substeps=3).step(10)
    np.testing.assert_allclose(general.x, along.x, rtol=0, atol=1e-13)


def test_order_eight():
    """Of positions and velocities, before round-off: 10 links fall for a quarter of a second."""
    model = straight(10)
    x, v = motion(model, 0.25)
    substeps = np.array([1, 2, 4])
    runs = [Frames(model, dt=0.25 / 6, substeps=int(s)).step(6) for s in substeps]
    for error in [np.abs(r.x - x).max() for r in runs], [np.abs(r.v - v).max() for r in runs]:
        slope = -np.polyfit(np.log(substeps), np.log(error), 1)[0]
        assert 7.5 < slope < 8.5


def test_error_is_what_was_asked():
    """Ten random chains over a second: never above, and not below a hundredth of it. Left out are chains whose own
    motion amplifies a disturbance more than 50 times in that second: nothing that looks at one step knows of it."""
    tried = 0
    for seed in range(40):
        model = random_chain(seed)
        rest = (model.v, model.w, model.gravity, 1e-13, 1e-14)
        x = references.chain([1.0], model.x, *rest)[0][-1]
        nudge = 1e-8 * np.random.default_rng(1).normal(size=model.x.shape) * (model.w > 0.0)[:, None]
        amplification = np.abs(references.chain([1.0], model.x + nudge, *rest)[0][-1] - x).max() / 1e-8
        if amplification > 50.0:
            continue
        for asked in (1e-6, 1e-8):
            error = np.linalg.norm(Frames(model, error=asked).step(60).x - x, axis=1).max()
            assert asked / 100.0 < error < asked, (seed, asked)
        tried += 1
        if tried == 10:
            return
    pytest.fail("too few chains")


def test_energy_of_ten_links_for_twenty_seconds():
    """Through every crack of the whip, within 1e-8 of its range."""
    model = straight(10)
    mass = np.where(model.w > 0.0, 0.1, 0.0)
    frames = Frames(model, error=1e-9)
    energies = []
    for _ in range(1200):
        frames.step()
        energies.append(mass @ (0.5 * np.sum(frames.v**2, axis=1) + 9.81 * frames.x[:, 1]))
    reach = 2.0 * 9.81 * mass @ np.linspace(0.0, 1.0, 11)  # from straight up to straight down
    assert np.abs(energies).max() < 1e-8 * reach


@pytest.mark.parametrize("how", ["grabbed", "led", "point"])
def test_a_particle_is_moved_evenly_over_the_frame(how):
    """The others follow at once, as the equations with a prescribed motion have it; it arrives to the last bit."""
    x = np.cumsum(np.random.default_rng(5).normal(size=(5, 3)), axis=0)
    fixed = [2] if how == "led" else []
    model = graph(x, [(k, k + 1) for k in range(4)], fixed=fixed, points=[2] if how == "point" else ())
    velocity = np.array([0.3, -0.2, 0.5])
    frames = Frames(model, error=1e-10)
    for frame in range(1, 4):
        target = x[2] + velocity * DT * frame
        if how == "grabbed":
            frames.grabbed.fill_(2)
            frames.w[2:3].zero_()
            frames.grab_target.assign(target[None])
        elif how == "point":
            frames.target.assign(target[None])
        else:
            frames.state.v[2:3].assign(((target - frames.x[2]) / DT)[None])
        frames.step()
    expected, expected_v = motion(model, 3 * DT, led=[2], velocity=velocity)
    np.testing.assert_allclose(frames.x, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(frames.v, expected_v, rtol=0, atol=1e-10)
    if how != "led":
        np.testing.assert_array_equal(frames.x[2], target)


@both_precisions
def test_both_precisions(dtype):
    frames = Frames(straight(10, dtype), error=1e-5).step(30)
    x = motion(straight(10), 0.5)[0]
    assert np.abs(frames.x - x).max() < {"float32": 5e-5, "float64": 5e-6}[dtype]


def test_steps_are_each_pieces_own():
    """A whip beside a single particle: the particle takes one step a frame."""
    model = graph(np.vstack([straight(10).x, [5, 0, 0]]), [(k, k + 1) for k in range(10)], fixed=[0])
    frames = Frames(model, error=1e-9)
    frames.step(20)
    assert sorted(frames.frame.steps_used.numpy()) == [1, frames.frame.substeps_used]
    assert frames.frame.substeps_used > 1


@pytest.mark.parametrize("settings", [{"error": 1e-6}, {"substeps": 4}])
@pytest.mark.parametrize("case", ["held too far apart", "contradictory"])
def test_what_nothing_satisfies_is_noted(case, settings):
    """The piece stays finite, and nothing runs for ever."""
    x, row = np.linspace([0.0, 0, 0], [1.0, 0, 0], 6), [(k, k + 1) for k in range(5)]
    if case == "held too far apart":
        model = graph(x, row, fixed=[0, 5], rest=0.19)
    else:
        model = graph(x, [*row, (1, 2)], fixed=[0], rest=[0.2] * 5 + [0.21])
    frames = Frames(model, **settings)
    frames.frame.step_frame()
    assert frames.failed == 0
    assert np.isfinite(frames.x).all()
    assert np.isfinite(frames.v).all()
    assert frames.frame.substeps_used < 100


def test_a_rope_taut_between_two_points():
    """Its tension is infinite, and one link too many holds it: steps of equal length are refused their frame, short ones
    keep it straight."""
    x = np.linspace([0.0, 0, 0], [1.0, 0, 0], 6)
    model = graph(x, [(k, k + 1) for k in range(5)], fixed=[0, 5])
    steps = Frames(model, substeps=4)
    steps.frame.step_frame()
    assert steps.failed == 0
    assert np.abs(Frames(model, error=1e-3).step(2).x - x).max() < 1e-7


def test_a_start_that_is_off_is_put_right():
    """Lengths and tangent, by the least change in the metric of the masses: momentum stays."""
    rng = np.random.default_rng(2)
    x, rest = np.cumsum(rng.normal(size=(6, 3)), axis=0), None
    rest = np.linalg.norm(np.diff(x, axis=0), axis=1) * 1.02
    mass = rng.uniform(0.5, 2.0, 6)
    model = graph(x, [(k, k + 1) for k in range(5)], mass=mass, rest=rest, v=rng.normal(size=(6, 3)))
    frames = Frames(model, error=1e-9).step()
    assert np.abs(model.distance.residual(frames.x)).max() < 1e-14
    fall = mass.sum() * np.asarray(model.gravity) * DT
    np.testing.assert_allclose(mass @ frames.v, mass @ model.v + fall, rtol=0, atol=1e-13)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf"), "x"])
def test_error_has_to_be_a_length_a_second(bad):
    with pytest.raises(InputError, match="error must be"):
        Frames(straight(3), error=bad)


def refused(what):
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], 3), stiffness=0.5 if what == "stiffness below 1" else 1.0)
    if what == "contacts":
        builder.enable_contacts()
    if what == "colliders":
        builder.add_plane((0, -1, 0), (0, 1, 0))
    if what == "points with compliance":
        builder.add_point(0, (0, 0, 0), compliance=1e-3)
    if what == "one point constraint":
        builder.add_point(0, (0, 0, 0))
        builder.add_point(0, (0, 0, 0))
    return builder.finalize()


@pytest.mark.parametrize(
    "what", ["contacts", "colliders", "stiffness below 1", "points with compliance", "one point constraint"]
)
def test_what_it_cannot_do_is_refused(what):
    with pytest.raises(InputError, match=what):
        Frames(refused(what))


def test_a_frame_is_one_launch_that_can_be_captured():
    model = straight(10)
    replayed, launched = Frames(model, error=1e-8), Frames(model, error=1e-8).step(20)
    wp.load_module(kernels.make_frame[wp.float64].module.name, device=model.device)
    with wp.ScopedCapture(device=model.device) as capture:
        replayed.frame.step_frame()
    for _ in range(20):
        wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(replayed.x, launched.x)
