"""A simulation from a checkpoint goes on as if it had never stopped; what is no checkpoint is refused."""

import json
import zipfile

import numpy as np
import pytest
from models import crowd_model, rope_model

import pbd_warp as pbd
from pbd_warp import checkpoint
from pbd_warp.model.flat import flat_arrays

CASES = {
    **{
        f"{name}, {integrator}": (rope_model, {"method": method, "integrator": integrator, "on_failure": "continue"})
        for name, method in {
            "jacobi": pbd.Jacobi(5),
            "chebyshev": pbd.Jacobi(15, chebyshev=0.9),
            "tolerance": pbd.GaussSeidel(50, tolerance=1e-4),
            "gauss-seidel": pbd.GaussSeidel(3),
            "direct": pbd.Direct(),
        }.items()
        for integrator in ("pbd", "bdf2", "midpoint", "midpoint4")
    },
    "compliant": (lambda **kw: rope_model(compliance=1e-4, **kw), {"method": pbd.Jacobi(5)}),
    "soft": (lambda **kw: rope_model(stiffness=0.5, **kw), {"method": pbd.Jacobi(5), "damping": 0.1}),
    "contacts": (lambda **kw: crowd_model(np.random.default_rng(7), **kw), {"depenetration_speed": 2.0}),
    "subdivide": (rope_model, {"method": pbd.Direct(7), "on_failure": "subdivide", "limits": pbd.Limits(5.0, 100.0)}),
    "explicit": (lambda **kw: rope_model(pinned=(), **kw), {"integrator": "dop853"}),
    "uncaptured": (rope_model, {"capture": False}),
}


def go_on(sim, first, last):
    """Frames first+1 .. last, held from the third to the eighth."""
    frames = []
    for frame in range(first, last):
        if frame == 2:
            sim.grab(2)
        if 2 <= frame < 8:
            sim.move_to(sim.model.x[2] + 0.004 * (frame - 1) * np.array([-1.0, 0.5, 0.2]))
        if frame == 8:
            sim.release()
        sim.step()
        frames.append(sim.state.x.numpy().tobytes() + sim.state.v.numpy().tobytes())
    return frames


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("case", CASES)
def test_a_resumed_simulation_is_the_same_to_the_last_bit(tmp_path, case, dtype):
    make, settings = CASES[case]
    model = make(dtype=dtype)
    sim = pbd.Simulation(model, substeps=2, **settings)
    whole = []
    for stop in (1, 5, 9):  # before, while and after it is held
        whole += go_on(sim, len(whole), stop)
        sim.save(tmp_path / f"{stop}.npz")
    whole += go_on(sim, 9, 12)
    assert whole[-1] != whole[-2]
    for stop in (1, 5, 9):
        resumed = pbd.Simulation.load(tmp_path / f"{stop}.npz")
        assert (resumed.frame, resumed.held) == (stop, 2 if stop == 5 else None)
        assert go_on(resumed, stop, 12) == whole[stop:]
        assert (resumed.retried, resumed.time) == (sim.retried, sim.time)


def test_point_targets_are_kept(tmp_path):
    builder = pbd.ModelBuilder()
    builder.add_particle((0, 0, 0))
    builder.add_point(0)
    sim = pbd.Simulation(builder.finalize())
    sim.point_target.assign([(0.0, 3.0, 0.0)])
    sim.save(tmp_path / "c.npz")
    resumed = pbd.Simulation.load(tmp_path / "c.npz")
    resumed.step()
    np.testing.assert_allclose(resumed.state.x.numpy()[0], (0, 3, 0), atol=1e-6)


def test_what_a_model_is_survives(tmp_path):
    model = crowd_model(np.random.default_rng(3))
    pbd.Simulation(model, method=pbd.Jacobi(3)).save(tmp_path / "c.npz")
    again = pbd.Simulation.load(tmp_path / "c.npz").model
    for (name, a), (other, b) in zip(flat_arrays(model), flat_arrays(again), strict=True):
        assert name == other
        np.testing.assert_array_equal(a, b, err_msg=name)
        assert a.dtype == b.dtype
    assert [list(rope) for rope in again.ropes] == [list(rope) for rope in model.ropes]


def test_restore_gives_back_what_the_caller_added(tmp_path):
    sim = pbd.Simulation(rope_model())
    sim.step()
    sim.save(tmp_path / "c.npz", {"worst": 0.1, "drag": [1, None]})
    other = pbd.Simulation(rope_model())
    other.restore(tmp_path / "c.npz")
    assert checkpoint.Checkpoint.read(tmp_path / "c.npz").extra == {"worst": 0.1, "drag": [1, None]}
    assert other.frame == 1
    np.testing.assert_array_equal(other.state.x.numpy(), sim.state.x.numpy())


@pytest.mark.parametrize(
    ("model", "settings", "message"),
    [
        (rope_model(7), {}, "is of another model: its x is not the same"),
        (rope_model(6, mass=3.0), {}, "is of another model: its w is not the same"),
        (rope_model(6, "float32"), {}, "is in float64, not float32"),
        (rope_model(6), {"substeps": 2}, "was made with substeps 1, not 2"),
        (rope_model(6), {"method": pbd.Jacobi(7)}, 'was made with method {"name": "jacobi", "iterations": 20'),
        (rope_model(6), {"integrator": "bdf2"}, "was made with integrator pbd, not bdf2"),
    ],
)
def test_a_checkpoint_of_something_else_is_refused(tmp_path, model, settings, message):
    pbd.Simulation(rope_model(6)).save(tmp_path / "c.npz")
    sim = pbd.Simulation(model, **settings)
    with pytest.raises(pbd.InputError) as caught:
        sim.restore(tmp_path / "c.npz")
    assert message in str(caught.value)
    assert sim.frame == 0


def test_there_is_no_file(tmp_path):
    with pytest.raises(pbd.InputError, match="there is no checkpoint"):
        pbd.Simulation.load(tmp_path / "c.npz")


@pytest.mark.parametrize("part", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_file_is_refused(tmp_path, part):
    path = tmp_path / "c.npz"
    pbd.Simulation(rope_model()).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(pbd.InputError, match="no whole checkpoint"):
        pbd.Simulation.load(path)


def test_every_flipped_byte_of_the_data_is_noticed(tmp_path):
    path = tmp_path / "c.npz"
    sim = pbd.Simulation(rope_model(3))
    sim.step()
    sim.save(path)
    whole = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        x = next(info for info in archive.infolist() if info.filename == "array/x.npy")
    middle = x.header_offset + 30 + len("array/x.npy") + x.file_size // 2
    damaged = bytearray(whole)
    damaged[middle] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(pbd.InputError, match="no whole checkpoint"):
        pbd.Simulation.load(path)


@pytest.mark.parametrize("content", ["text", "npy", "npz", "zip"])
def test_a_foreign_file_is_refused(tmp_path, content):
    path = tmp_path / "c.npz"
    if content == "text":
        path.write_text("#usda 1.0\n")
    elif content == "zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("readme.txt", "hello")
    else:
        with open(path, "wb") as file:
            np.save(file, np.zeros(3)) if content == "npy" else np.savez(file, header=np.zeros(3, np.uint8))
    with pytest.raises(pbd.InputError, match="no whole checkpoint"):
        pbd.Simulation.load(path)


def test_an_older_file_is_refused(tmp_path):
    path = tmp_path / "c.npz"
    pbd.Simulation(rope_model()).save(path)
    with np.load(path) as archive:
        members = dict(archive)
    header = json.loads(members["header"].tobytes())
    members["header"] = np.frombuffer(json.dumps({**header, "version": 0}).encode(), np.uint8)
    np.savez(path, **members)
    with pytest.raises(pbd.InputError, match=r"has format version 0 .* reads version 2"):
        pbd.Simulation.load(path)


def test_a_failed_write_leaves_the_older_file(tmp_path, monkeypatch):
    path = tmp_path / "c.npz"
    sim = pbd.Simulation(rope_model())
    sim.save(path)
    before = path.read_bytes()

    def full(*args, **kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.raises(pbd.SimulationFailed, match="No space left on device"):
        sim.save(path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["c.npz"]


def test_a_missing_folder_is_bad_input(tmp_path):
    with pytest.raises(pbd.InputError, match="does not exist"):
        pbd.Simulation(rope_model()).save(tmp_path / "there" / "c.npz")


@pytest.mark.parametrize("spoil", ["setting", "limit", "method", "missing", "members"])
def test_a_file_of_another_pbd_warp_is_refused(tmp_path, spoil):
    path = tmp_path / "c.npz"
    pbd.Simulation(rope_model()).save(path)
    with np.load(path) as archive:
        members = dict(archive)
    header = json.loads(members["header"].tobytes())
    if spoil == "setting":
        header["settings"]["viscosity"] = 1.0
    elif spoil == "limit":
        header["settings"]["limits"]["speed"] = 1.0
    elif spoil == "method":
        header["settings"]["method"]["omega"] = 1.0
    elif spoil == "missing":
        del header["settings"]["damping"]
    else:
        del members["model/colliders.kind"]
    members["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **members)
    with pytest.raises(pbd.InputError, match=r"does not fit this pbd-warp|no whole checkpoint"):
        pbd.Simulation.load(path)


def test_no_damage_ends_in_a_traceback(tmp_path):
    """Every byte of the archive's own tables, at its end, flipped."""
    path = tmp_path / "c.npz"
    pbd.Simulation(rope_model(2)).save(path)
    whole = path.read_bytes()
    refused = 0
    for place in range(len(whole) - 900, len(whole), 3):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            pbd.Simulation.load(path)
        except pbd.InputError:
            refused += 1
    assert refused > 100
