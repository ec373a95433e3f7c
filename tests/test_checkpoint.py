"""A simulation from a checkpoint goes on as if it had never stopped; what is no checkpoint is refused."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from models import crowd_model, heap_model, rope_model, state

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
    "links": (lambda **kw: heap_model(np.random.default_rng(7), ropes=4, **kw), {"max_contacts": 4000}),
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
    with pytest.raises(pbd.InputError, match=r"has format version 0 .* reads version 3"):
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


def rewritten(path, change):
    """The file with another header or other members: what no damage makes, but somebody could."""
    with np.load(path) as archive:
        members = {name: archive[name] for name in archive.files}
    header = json.loads(members["header"].tobytes())
    change(header, members)
    members["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **members)


def put(name, index, value):
    def change(header, members):
        members[name] = members[name].copy()
        members[name][index] = value

    return change


def header_with(*keys, value):
    def change(header, members):
        table = header
        for key in keys[:-1]:
            table = table[key]
        table[keys[-1]] = value

    return change


CRAFTED = {
    "an edge of no particle": put("model/distance.edge", (1, 0), 1000),
    "an edge before the first particle": put("model/distance.edge", (1, 0), -1),
    "an edge of one particle": put("model/distance.edge", 1, 2),
    "a position that is not finite": put("model/x", (1, 0), np.nan),
    "a negative inverse mass": put("model/w", 1, -1.0),
    "a rope along no particle": put("model/ropes", 2, 77),
    "ropes that are too long": put("model/rope_lengths", 0, 7),
    "another component": put("model/component", 2, 5),
    "a stiffness above 1": put("model/distance.stiffness", 0, 1.5),
    "a device edge of no particle": put("array/distance.edge", (0, 0), 1 << 30),
    "a device state that is not finite": put("array/x", (0, 0), np.inf),
    "another precision": lambda header, members: members.update({"array/v": members["array/v"].astype(np.float32)}),
    "another shape": lambda header, members: members.update({"array/u": members["array/u"][:-1]}),
    "a member that is text": lambda header, members: members.update({"array/u": np.array(["x"])}),
    "frame -1": header_with("progress", "frame", value=-1),
    "frame 1e300": header_with("progress", "frame", value=1e300),
    "no progress": header_with("progress", value=[]),
    "no kinematic": header_with("progress", "moved", "kinematic", value=None),
    "a held particle of none": header_with("progress", "moved", "kinematic", "held", value=99),
    "a target in two dimensions": header_with("progress", "moved", "kinematic", "held_target", value=[0, 1]),
    "paths of no particle": header_with("progress", "moved", "kinematic", "paths", value=[[0, [99]], [None, []]]),
    "one path": header_with("progress", "moved", "kinematic", "paths", value=[[0, []]]),
    "substeps that overflow": header_with("settings", "substeps", value=1 << 31),
    "a setting of another type": header_with("settings", "limits", value=3),
    "extra that is no table": header_with("extra", value=3),
    "a dtype of none": header_with("dtype", value="float16"),
    "a dtype that is no text": header_with("dtype", value=[]),
    "a version that is no number": header_with("version", value={"a": 1}),
}


@pytest.mark.parametrize("what", CRAFTED)
def test_a_crafted_file_is_refused(tmp_path, what):
    path = tmp_path / "c.npz"
    sim = pbd.Simulation(rope_model())
    sim.step()
    sim.save(path)
    rewritten(path, CRAFTED[what])
    with pytest.raises(pbd.InputError):
        pbd.Simulation.load(path)
    before = state(sim)
    with pytest.raises(pbd.InputError):
        sim.restore(path)
    np.testing.assert_array_equal(before, state(sim))


INTEGERS = """
import sys
import numpy as np
import pbd_warp as pbd
from models import crowd_model, heap_model, rope_model, state
from test_checkpoint import put, rewritten

cases = [(rope_model(), {"method": pbd.Direct(7, tolerance=1e-6)}), (rope_model(), {"integrator": "bdf2"}),
         (rope_model(pinned=()), {"integrator": "dop853"}), (crowd_model(np.random.default_rng(3)), {})]
for model, settings in cases:
    sim = pbd.Simulation(model, **settings)
    sim.step()
    names = [name for name, array in sim._context.arrays.items() if array.numpy().dtype.kind in "iu" and array.size]
    assert names
    for name in names:
        for value in (-(1 << 31), -1, 1 << 20, (1 << 31) - 1):
            sim.save("c.npz")
            rewritten("c.npz", put(f"array/{name}", slice(None), value))
            try:
                other = pbd.Simulation.load("c.npz")
                other.contact_pairs, other.iterations_used, other.unconverged
                other.step()
            except pbd.PbdError:
                pass
print("alive")
"""


def test_no_crafted_index_crashes(tmp_path):
    """Whatever integers a file has for what a simulation goes on with."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
    result = subprocess.run(
        [sys.executable, "-c", INTEGERS],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    assert "alive" in result.stdout


def test_a_state_that_is_not_finite_is_not_kept(tmp_path):
    sim = pbd.Simulation(rope_model())
    sim.save(tmp_path / "c.npz")
    before = (tmp_path / "c.npz").read_bytes()
    sim.state.x.fill_(np.nan)
    with pytest.raises(pbd.SimulationFailed, match="not finite"):
        sim.save(tmp_path / "c.npz")
    assert (tmp_path / "c.npz").read_bytes() == before
