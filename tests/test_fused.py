"""Frames in one launch: the same as launch by launch, many in a call, and what becomes of those that fail."""

import hashlib

import numpy as np
import pytest
from models import crowd_model, rope_model

import pbd_warp as pbd
from pbd_warp.step import program
from pbd_warp.step.launch import Launcher


def soft_rope(dtype="float32"):
    builder = pbd.ModelBuilder()
    rope = builder.add_rope(np.linspace([0.0, 0, 0], [1, 0, 0], 8), pinned=(0,), compliance=1e-4)
    builder.add_point(rope[-1], target=(1.0, 0.3, 0.2), compliance=1e-4)
    return builder.finalize(dtype=dtype)


def crowd(dtype="float32"):
    return crowd_model(np.random.default_rng(2), dtype=dtype)


FUSED = {
    "jacobi": (rope_model, {"method": pbd.Jacobi(4), "damping": 0.2}),
    "chebyshev": (rope_model, {"method": pbd.Jacobi(12, chebyshev=0.9)}),
    "valence": (rope_model, {"method": pbd.Jacobi(4, averaging="valence")}),
    "gauss-seidel": (rope_model, {"method": pbd.GaussSeidel(2), "damping": 0.1}),
    "jacobi to a tolerance": (rope_model, {"method": pbd.Jacobi(50, tolerance=1e-4)}),
    "gauss-seidel to a tolerance": (rope_model, {"method": pbd.GaussSeidel(50, tolerance=1e-4)}),
    "bdf2": (rope_model, {"integrator": "bdf2"}),
    "midpoint": (rope_model, {"integrator": "midpoint"}),
    "midpoint4": (rope_model, {"integrator": "midpoint4"}),
    "compliance": (soft_rope, {"method": pbd.GaussSeidel(2)}),
    "stiffness": (rope_model, {"stiffness": 0.5}),
    "depenetration": (rope_model, {"depenetration_speed": 1.0}),
    "energy": (rope_model, {"limits": pbd.Limits(energy=1e6)}),
    "crowd": (crowd, {"method": pbd.Jacobi(4), "damping": 0.1}),
    "crowd, gauss-seidel to a tolerance": (crowd, {"method": pbd.GaussSeidel(9, tolerance=1e-3)}),
    "subdivide": (rope_model, {"on_failure": "subdivide"}),
}


def fingerprint(sim):
    arrays = {name: array.numpy().tobytes() for name, array in sim._context.arrays.items()}
    return {name: hashlib.sha256(data).hexdigest() for name, data in arrays.items()}


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("case", FUSED)
def test_every_array_is_the_same_as_launch_by_launch(case, dtype):
    make, settings = FUSED[case]
    settings = {"substeps": 3, **settings}
    one, other = (pbd.Simulation(make(dtype=dtype), capture=capture, **settings) for capture in (True, False))
    assert one.fused
    assert one.launches == 1
    assert not other.fused
    assert other.launches > 3 * len(other.passes)
    assert one.passes == other.passes
    for sim in (one, other):
        for _ in range(4):
            sim.step()
    assert not np.array_equal(one.state.x.numpy(), one.model.x)
    assert fingerprint(one) == fingerprint(other)


@pytest.mark.parametrize("capture", [True, False])
@pytest.mark.parametrize("case", ["jacobi", "crowd", "gauss-seidel to a tolerance"])
def test_many_frames_in_a_call_are_the_same_as_one_by_one(case, capture):
    make, settings = FUSED[case]
    one, other = (pbd.Simulation(make(), capture=capture, substeps=2, **settings) for _ in range(2))
    one.step(frames=7)
    for _ in range(7):
        other.step()
    assert one.frame == other.frame == 7
    assert fingerprint(one) == fingerprint(other)


def test_what_is_moved_rests_after_the_first_of_many_frames():
    one, other = (pbd.Simulation(rope_model(6), substeps=2) for _ in range(2))
    for sim in (one, other):
        sim.grab(5)
        sim.move_to(sim.model.x[5] + [0.0, 0.05, 0.0])
    one.step(frames=5)
    for _ in range(5):
        other.step()
    assert fingerprint(one) == fingerprint(other)
    np.testing.assert_allclose(one.state.x.numpy()[5], one.model.x[5] + [0.0, 0.05, 0.0], atol=1e-6)


@pytest.mark.parametrize("capture", [True, False])
def test_many_frames_stop_at_the_one_that_failed(capture):
    """Few sweeps hold the rope less the faster it falls."""
    limits = pbd.Limits(stretch=0.5)
    one, other = (
        pbd.Simulation(rope_model(20), capture=capture, limits=limits, method=pbd.Jacobi(1)) for _ in range(2)
    )
    for sim in (one, other):
        with pytest.raises(pbd.SimulationFailed, match="frame "):
            sim.step(frames=200) if sim is one else [sim.step() for _ in range(200)]
    assert 1 < one.frame < 200
    assert one.frame == other.frame
    np.testing.assert_array_equal(one.state.x.numpy(), other.state.x.numpy())


def test_a_frame_made_again_is_followed_by_the_rest_of_them():
    settings = {"on_failure": "subdivide", "limits": pbd.Limits(stretch=0.35), "method": pbd.Jacobi(4)}
    one, other = (pbd.Simulation(rope_model(20), **settings) for _ in range(2))
    one.step(frames=15)
    for _ in range(15):
        other.step()
    assert one.frame == 15
    assert one.retried == other.retried > 0
    assert fingerprint(one) == fingerprint(other)


@pytest.mark.parametrize("frames", [0, -1, 1.5, True, None, "2"])
def test_frames_is_a_whole_number(frames):
    sim = pbd.Simulation(rope_model())
    with pytest.raises(pbd.InputError, match="frames"):
        sim.step(frames=frames)
    assert sim.frame == 0


def test_what_no_machine_can_do_is_replayed_launch_by_launch(monkeypatch):
    assert not pbd.Simulation(rope_model(), method=pbd.Direct()).fused
    monkeypatch.setattr("pbd_warp.step.constraints.contact.WITHOUT_GRID", 5)
    assert not pbd.Simulation(crowd()).fused


def test_one_thread_and_replayed_launches_make_the_same_frames(monkeypatch):
    """Where a frame is not fused for its size, it is the same one."""
    one = pbd.Simulation(rope_model(9), substeps=2, damping=0.1)
    monkeypatch.setattr(program.Program, "pays", lambda *_: False)
    other = pbd.Simulation(rope_model(9), substeps=2, damping=0.1)
    assert one.fused
    assert not other.fused
    for sim in (one, other):
        sim.step(frames=5)
    assert fingerprint(one) == fingerprint(other)


def test_pairs_are_found_with_and_without_a_grid(monkeypatch):
    """The same contacts, if in another order: of a crowd with joined and fixed particles, some of them fast."""

    def contacts(sim):
        found = {}
        count = int(sim._loop.contacts.count.numpy()[0])
        arrays = [getattr(sim._loop.contacts, name).numpy()[:count] for name in ("pair", "normal", "gap")]
        for (i, j), normal, gap in zip(*arrays, strict=True):
            side = 1.0 if i < j or j < 0 else -1.0
            found[(i, j) if j < 0 else (min(i, j), max(i, j))] = (*(side * normal), gap)
        assert len(found) == count
        return found

    sims = []
    for limit in (400, 5):
        monkeypatch.setattr("pbd_warp.step.constraints.contact.WITHOUT_GRID", limit)
        sims.append(pbd.Simulation(crowd_model(np.random.default_rng(2), n=100)))
        sims[-1].step()
    without, with_grid = map(contacts, sims)
    assert sims[0]._loop.contacts.grid is None
    assert sims[1]._loop.contacts.grid is not None
    assert len([j for _, j in without if j >= 0]) > 10
    assert without.keys() == with_grid.keys()
    np.testing.assert_allclose([without[p] for p in without], [with_grid[p] for p in without], atol=1e-12)


def test_a_launcher_writes_down_what_it_would_have_launched():
    sim = pbd.Simulation(rope_model(), method=pbd.Jacobi(3))
    launch: Launcher = sim._context.launch
    before = fingerprint(sim)
    with launch.record() as written:
        sim._loop.run_step()
    assert written.passes == len(sim.passes)
    assert written.obstacle is None
    assert fingerprint(sim) == before
