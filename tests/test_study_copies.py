"""Many small simulations in one: every copy moves as it would alone, and one that diverges stops no other."""

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.measure import measure_copies
from pbd_warp.model.copies import join
from pbd_warp.step.constraints import contact
from pbd_warp.step.integrators import INTEGRATORS

LINKS = 5
METHODS = [pbd.Jacobi(5), pbd.GaussSeidel(5), pbd.Direct()]


def chain(mass=1.0, length=1.0, tilt=0.0, compliance=0.0):
    builder = pbd.ModelBuilder()
    s = np.linspace(0.0, length, LINKS + 1)
    builder.add_rope(np.stack([s * np.cos(tilt), s * np.sin(tilt), 0 * s], axis=1), mass=mass, compliance=compliance)
    builder.add_point(3, compliance=0.1)
    builder.add_plane((0, -0.5, 0), (0, 1, 0))
    return builder


def run(model, frames=10, **settings):
    sim = pbd.Simulation(model, **settings)
    for _ in range(frames):
        sim.step()
    return sim


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("method", METHODS)
def test_a_copy_moves_as_it_would_alone_to_the_last_bit(method, dtype):
    models = [chain(*each).finalize(dtype=dtype) for each in ((1, 1, 0), (3, 0.7, 0.4), (0.2, 2, -0.3))]
    settings = {"method": method, "substeps": 3, "damping": 0.2}
    together = run(join(models), **settings)
    x = together.state.x.numpy().reshape(3, LINKS + 1, 3)
    v = together.state.v.numpy().reshape(3, LINKS + 1, 3)
    measured = measure_copies(together)
    for k, model in enumerate(models):
        alone = run(model, **settings)
        assert np.array_equal(alone.state.x.numpy(), x[k])
        assert np.array_equal(alone.state.v.numpy(), v[k])
        for name, value in vars(measure_copies(alone)).items():
            assert np.array_equal(value[0], getattr(measured, name)[k]), name
    assert len(np.unique(x, axis=0)) == 3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("integrator", [name for name in INTEGRATORS if name != "pbd"])
def test_with_every_integrator_too(method, integrator):
    def falling(tilt):
        builder = pbd.ModelBuilder()
        s = np.linspace(0.0, 1.0, LINKS + 1)
        builder.add_rope(np.stack([s * np.cos(tilt), s * np.sin(tilt), 0 * s], axis=1))
        return builder.finalize()

    models = [falling(tilt) for tilt in (0.0, 0.4)]
    settings = {"method": method, "integrator": integrator, "substeps": 2}
    together = run(join(models), **settings).state.x.numpy().reshape(2, LINKS + 1, 3)
    for x, model in zip(together, models, strict=True):
        assert np.array_equal(x, run(model, **settings).state.x.numpy())


@pytest.mark.parametrize("method", METHODS)
def test_a_copy_of_a_net_too(method):
    n = 4
    at = np.stack([*np.meshgrid(np.arange(n), np.arange(n)), np.zeros((n, n))], axis=-1).reshape(-1, 3)
    number = np.arange(n * n).reshape(n, n)
    edges = np.concatenate(
        [
            np.stack([a.ravel(), b.ravel()], axis=1)
            for a, b in ((number[:-1], number[1:]), (number.T[:-1], number.T[1:]))
        ]
    )

    def net(depth):
        builder = pbd.ModelBuilder()
        builder.add_graph(at + [0, 0, depth] * (at[:, :1] - at[:, 1:2]), edges, pinned=(0, n - 1))
        return builder.finalize()

    models = [net(depth) for depth in (0.0, 0.1, 0.3)]
    together = run(join(models), method=method).state.x.numpy().reshape(3, -1, 3)
    for x, model in zip(together, models, strict=True):
        assert np.array_equal(x, run(model, method=method).state.x.numpy())


def test_replicate_varies_what_it_is_told_to():
    n = 4
    builder = chain()
    x = builder.finalize().x[None] * np.array([1.0, 2, 3, 4])[:, None, None]
    mass, rest = np.array([[1.0], [2], [3], [4]]), np.array([[0.2], [0.4], [0.6], [0.8]])
    model = builder.replicate(n, positions=x, mass=mass, rest_length=rest, compliance=1e-3 * rest).finalize()
    assert (model.copy_count, model.particle_count, len(model.ropes)) == (n, n * (LINKS + 1), n)
    assert np.array_equal(model.x.reshape(n, LINKS + 1, 3), x)
    assert np.array_equal(model.mass.reshape(n, -1), np.c_[np.zeros(n), np.repeat(mass, LINKS, axis=1)])
    assert np.array_equal(model.distance.rest_length.reshape(n, -1), np.repeat(rest, LINKS, axis=1))
    assert np.array_equal(model.point.particle, [3 + k * (LINKS + 1) for k in range(n)])
    assert len(model.colliders.kind) == 1
    assert len(np.unique(model.component)) == n
    assert builder.finalize().copy_count == 1


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"masses": [[1.0], [1.0]]}, "unknown value that varies by copy 'masses'.*did you mean 'mass'"),
        ({"mass": np.ones((3, 1))}, r"mass of 2 copies must be numbers of shape \[2, 6\]"),
        ({"mass": [[1.0], [0.0]]}, "mass of copy 1 must be finite and not negative, and not 0: number 0 is 0"),
        ({"rest_length": [[1.0], [np.nan]]}, "rest_length of copy 1 must be finite"),
        ({"stiffness": [[0.5], [2.0]]}, "stiffness of copy 1 .*at most 1"),
        ({"stiffness": [[0.5]], "compliance": [[1.0]]}, "stiffness below 1 and a compliance"),
        ({"positions": np.full((2, 6, 3), 1e39)}, "too large a number for float32"),
    ],
)
def test_bad_copies_are_refused(values, message):
    with pytest.raises(pbd.InputError, match=message):
        chain().replicate(2, **values).finalize()


def test_only_one_graph_is_joined():
    with pytest.raises(pbd.InputError, match="same graph"):
        join([chain().finalize(), chain(compliance=1e-3).finalize()])


@pytest.mark.parametrize("method", METHODS)
def test_a_copy_that_diverges_is_marked_and_stops_no_other(method):
    builder = chain()
    v = np.zeros((3, LINKS + 1, 3))
    v[1, -1] = 0, 0, 1e25  # beyond float32 within the first frame
    settings = {"method": method}
    model = builder.replicate(3, velocity=v).finalize()
    sim = run(model, **settings)
    assert list(sim.failures) == [1]
    assert sim.failures[1].startswith("frame 1 (t = 0.0166667 s): ")
    good = run(builder.finalize(), **settings)
    x = sim.state.x.numpy().reshape(3, LINKS + 1, 3)
    for k in (0, 2):
        assert np.array_equal(x[k], good.state.x.numpy())
    energy = measure_copies(sim).energy
    assert np.isnan(energy[1])
    assert np.isfinite(energy[[0, 2]]).all()
    alone = pbd.Simulation(pbd.ModelBuilder.replicate(builder, 1, velocity=v[1:2]).finalize(), **settings)
    with pytest.raises(pbd.SimulationFailed) as failed:
        alone.step()
    assert str(failed.value) == sim.failures[1]
    sim.reset()
    assert sim.failures == {}
    assert np.isfinite(measure_copies(sim).energy).all()
    sim.step()
    assert list(sim.failures) == [1]


def test_a_copy_that_does_not_converge_is_marked_and_stops_no_other():
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0.0, 0, 0], [1.0, 0, 0], LINKS + 1))
    fast = np.zeros((3, LINKS + 1, 3))
    fast[1, -1] = 0, 100, 0
    settings = {"method": pbd.Direct(iterations=6), "frames": 5}
    sim = run(builder.replicate(3, velocity=fast).finalize(), **settings)
    assert list(sim.failures) == [1]
    with pytest.raises(pbd.SimulationFailed, match="Newton's method did not converge in 1 solution ") as failed:
        run(builder.replicate(1, velocity=fast[1:2]).finalize(), **settings)
    assert str(failed.value) == sim.failures[1]
    alone = run(builder.finalize(), **settings).state.x.numpy()
    assert np.array_equal(sim.state.x.numpy().reshape(3, -1, 3)[[0, 2]], [alone, alone])
    settings["on_failure"] = "continue"
    assert run(builder.replicate(3, velocity=fast).finalize(), **settings).failures == {}


def test_limits_hold_for_each_copy(tmp_path):
    v = np.zeros((4, LINKS + 1, 3))
    v[2, 1:, 0] = 1.0
    limits = pbd.Limits(energy=1e-3)
    model = chain().replicate(4, velocity=v, compliance=[[1e-6], [10.0], [1e-6], [1e-6]])
    sim = run(model.finalize(), frames=30, method=pbd.GaussSeidel(40), limits=pbd.Limits(stretch=0.5))
    assert list(sim.failures) == [1]
    assert "distance 0 is stretched beyond the limit of 50 %" in sim.failures[1]
    sim.save(tmp_path / "c.npz")
    assert pbd.Simulation.load(tmp_path / "c.npz").failures == sim.failures
    sim = run(chain().replicate(2).finalize(), method=pbd.GaussSeidel(40), limits=limits)
    assert sim.failures == {}


def test_many_frames_in_one_call_note_the_frame_in_which_a_copy_failed():
    stretched = chain().replicate(3, compliance=[[1e-6], [0.05], [10.0]]).finalize()
    settings = {"method": pbd.GaussSeidel(40), "limits": pbd.Limits(stretch=0.5)}
    one_by_one = run(stretched, frames=30, **settings)
    assert sorted(one_by_one.failures) == [1, 2]
    assert len({text.split(" (")[0] for text in one_by_one.failures.values()}) == 2, "both in one frame"
    at_once = pbd.Simulation(stretched, **settings)
    at_once.step(frames=30)
    assert (at_once.frame, at_once.failures) == (30, one_by_one.failures)
    assert np.array_equal(at_once.state.x.numpy(), one_by_one.state.x.numpy())


def test_when_no_copy_is_left_the_run_has_failed():
    v = np.zeros((2, LINKS + 1, 3))
    v[:, -1] = 0, 0, 1e25
    with pytest.raises(pbd.SimulationFailed, match="all 2 copies have diverged, copy 0 in frame 1"):
        run(chain().replicate(2, velocity=v).finalize())


@pytest.mark.parametrize("without_grid", [300, 0])
def test_copies_do_not_meet(monkeypatch, without_grid):
    monkeypatch.setattr(contact, "WITHOUT_GRID", without_grid)
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles([(0, 0, 0), (0.5, 0, 0)], velocity=[(1, 0, 0), (-1, 0, 0)], radius=0.1)
    builder.enable_contacts()
    settings = {"frames": 30, "method": pbd.Jacobi(5)}
    alone = run(builder.finalize(), **settings)
    assert np.ptp(alone.state.x.numpy()[:, 0]) < 0.3
    together = run(builder.replicate(3).finalize(), **settings).state.x.numpy().reshape(3, 2, 3)
    assert np.array_equal(together, np.repeat(alone.state.x.numpy()[None], 3, axis=0))


@pytest.mark.parametrize(
    ("settings", "message"),
    [({"on_failure": "subdivide"}, "would make all copies"), ({"integrator": "dop853"}, "takes no copies")],
)
def test_what_does_not_go_with_copies_is_refused(settings, message):
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0)])
    with pytest.raises(pbd.InputError, match=message):
        pbd.Simulation(builder.replicate(2).finalize(), **settings)
