"""Studies, charts and maps on worker processes: the same rows, whatever happens to the processes."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

import pbd_warp as pbd
from pbd_warp import workers
from pbd_warp.accuracy.sweep import Sweep, sweep_scene
from pbd_warp.cores import cores
from pbd_warp.stability.atlas import measure_map
from pbd_warp.stability.maps import MAPS
from pbd_warp.study.store import load
from pbd_warp.workers import DaskPool, Lost, open_pool, open_some

cloudpickle = pytest.importorskip("cloudpickle")
pytest.importorskip("distributed")

OWN = """
import os, time
import numpy as np
import pbd_warp as pbd

def scene(mass: float = 1.0, seed: int = 0, slow: float = 0.0, kill: bool = False):
    if kill:
        os._exit(9)
    time.sleep(slow)
    builder = pbd.ModelBuilder()
    z = np.random.default_rng(seed).normal(0.0, 0.01, 4)
    builder.add_rope(np.stack([np.arange(4.0), 0 * z, z], axis=1), mass=mass)
    return pbd.Scene(builder, frames=4)

def lowest(sim):
    return sim.positions[:, 1].min()
"""


@pytest.fixture(scope="module")
def cluster():
    with open_pool(2) as pool:
        yield pool


@pytest.fixture
def own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(OWN)
    return "own.py"


def address(pool):
    return pool._client.scheduler.address


def results(pool, function, items):
    return dict(pool.run(function, items, lambda: None))


def test_rows_are_the_same_whatever_the_number_of_workers(own, cluster):
    grid = {"mass": [0.5, 1.0], "method": ["jacobi", "direct"]}
    measures = ["max_stretch", "energy", "tip"]
    two = pbd.study(own, grid, measures, seed=range(10), scheduler=address(cluster))
    one = pbd.study(own, grid, measures, seed=range(10), workers=1)
    assert len(two) == 40
    assert one["energy"].nunique() == 40
    same = [name for name in one.columns if name not in ("wall_s", "together")]
    assert one[same].equals(two[same])
    assert (one["outcome"] == "finished").all()


def test_own_scenes_and_measures_travel(cluster):
    def lean(angle: float = 0.1):
        builder = pbd.ModelBuilder()
        builder.add_rope([(0, 0, 0), (1, angle, 0)])
        return pbd.Scene(builder, frames=2)

    def frames(sim):
        return sim.frame

    rows = pbd.study(lean, {"angle": [0.1, 0.2]}, [frames], scheduler=address(cluster))
    assert rows["frames"].to_list() == [1, 1]


def kills_at_three(items):
    if 3 in items:
        os._exit(9)
    return [10 * item for item in items]


def test_what_kills_its_worker_three_times_is_given_up_and_nothing_else(cluster):
    found = results(cluster, kills_at_three, list(range(8)))
    assert found == {k: Lost(3) if k == 3 else 10 * k for k in range(8)}


def test_a_row_that_kills_is_a_failed_row(own, cluster):
    rows = pbd.study(own, {"kill": [False, True]}, scheduler=address(cluster))
    assert rows["outcome"].to_list() == ["finished", "failed"]
    assert rows["sentence"][1] == "it has killed its worker 3 times"


def test_a_worker_that_is_killed_is_replaced_and_its_rows_run_again(cluster):
    def slow(items):
        time.sleep(0.05)
        return [(item, os.getpid()) for item in items]

    killed, found = [], {}
    for number, (item, pid) in cluster.run(slow, list(range(40)), lambda: None):
        found[number] = item
        if len(found) in (5, 15):
            os.kill(pid, signal.SIGKILL)
            killed.append(pid)
    assert len(set(killed)) == 2
    assert found == {k: k for k in range(40)}


def test_a_worker_that_takes_long_to_come_back_is_replaced_too():
    """Dask gives it up for good after a while, here at once."""
    import dask

    with open_pool(1) as pool, dask.config.set({"distributed.deploy.lost-worker-timeout": "1 ms"}):
        assert results(pool, kills_at_three, [3, 4]) == {0: Lost(3), 1: 40}


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="processes are not kept on cores here")
def test_each_worker_has_a_core_to_itself(cluster):
    if cores() < 2:
        pytest.skip("one core")
    found = results(cluster, lambda items: time.sleep(0.1) or [os.sched_getaffinity(0)] * len(items), list(range(8)))
    assert all(len(own) == 1 for own in found.values())
    assert len(set().union(*found.values())) == 2


def test_an_error_in_the_work_is_raised_here(cluster):
    with pytest.raises(ZeroDivisionError):
        results(cluster, lambda items: [1 / item for item in items], [1, 0])


def test_tick_ends_a_run_that_is_under_way(cluster):
    def stop():
        raise KeyboardInterrupt

    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        list(cluster.run(lambda items: time.sleep(3.0) or items, [1, 2], stop))
    assert time.monotonic() - start < 2.0


SMALL = replace(MAPS["relaxation"], x=replace(MAPS["relaxation"].x, values=(1, 4)))


def test_a_map_is_the_same_with_workers(cluster):
    small = replace(SMALL, y=replace(SMALL.y, values=(0.5, 1.0, 1.9)))
    assert measure_map(small, pool=cluster).cells == measure_map(small).cells


@pytest.mark.parametrize("name", MAPS)
def test_what_a_map_runs_travels(name):
    cloudpickle.dumps([panel.cell for panel in MAPS[name].panels.values()])


def test_a_chart_is_the_same_with_workers_but_for_its_times(cluster):
    scene, sweep = pbd.load_scene("pendulum"), Sweep(substeps=(1, 4), iterations=(5,), dtypes=("float64",), repeat=1)
    here, there = sweep_scene(scene, sweep), sweep_scene(scene, sweep, pool=cluster)
    assert len(here.rows) > 20
    for a, b in zip(here.rows, there.rows, strict=True):
        untimed = {"wall_ms_per_sim_second": 0.0, "wall_spread": 0.0}
        assert replace(a, **untimed) == replace(b, **untimed)
        assert b.wall_ms_per_sim_second > 0.0
    assert "one at a time" in there.info["timed"]


def test_one_worker_is_this_process():
    with open_some(1) as pool:
        assert not isinstance(pool, DaskPool)


def test_who_gives_both_or_none_is_told(monkeypatch):
    for arguments, message in (((2, "tcp://x"), "give one of the two"), ((0,), "workers must be at least 1")):
        with pytest.raises(pbd.InputError, match=message), open_pool(*arguments):
            pass
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(pbd.InputError, match=r"pip install 'pbd-warp\[scale\]'"), open_pool(2):
        pass


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr(workers, "PATIENCE", 1.0)
    with (
        pytest.raises(pbd.InputError, match=r"no Dask scheduler at tcp://127\.0\.0\.1:9"),
        open_pool(scheduler="tcp://127.0.0.1:9"),
    ):
        pass


def test_workers_of_another_version_are_refused(cluster, monkeypatch):
    monkeypatch.setattr(workers, "__version__", "0.0.9")
    with (
        pytest.raises(pbd.InputError, match=r"worker tcp.* has pbd-warp 0\.1\.0.*here it is 0\.0\.9: install the same"),
        open_pool(scheduler=address(cluster)),
    ):
        pass


def test_command(own, cluster, call):
    command = (
        "study",
        own,
        "--set",
        "mass=1:4:lin4",
        "--seed",
        "0..1",
        "--measure",
        "energy,lowest",
        "--method",
        "direct",
    )
    code, out, err = call(*command, "--scheduler", address(cluster), "--out", "s.parquet")
    assert (code, out) == (0, "8 rows (8 finished): s.parquet\n"), err
    frame = load(Path("s.parquet"))
    assert frame["method"].unique().tolist() == ["direct"]
    assert frame["lowest"].lt(0.0).all()
    assert call(*command, "--out", "s.parquet")[:2] == (0, "8 rows (8 finished): s.parquet\n")  # without workers
    assert call("study", "plot", "s.parquet", "--x", "mass", "--y", "energy", "--hue", "seed")[:2] == (0, "s.svg\n")
    assert ">mass<" in Path("s.svg").read_text()
    for args, message in (
        (["--y", "enrgy"], "unknown column 'enrgy'.*did you mean 'energy'"),
        (["--y", "machine"], "column machine is not of numbers"),
    ):
        code, _, err = call("study", "plot", "s.parquet", "--x", "mass", *args)
        assert code == 2
        assert all(part in err for part in message.split(".*")), err


def test_command_tells_what_the_first_row_that_is_not_finished_says(own, cluster, call):
    args = ["--set", "mass=1,-1,-2", "--scheduler", address(cluster), "--out", "s.parquet"]
    code, out, err = call("study", own, *args)
    assert (code, out) == (0, "3 rows (1 finished, 2 refused): s.parquet\n")
    assert "row 1, the first that is not finished: scene own.py: mass" in err


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["own.py", "--set", "mass"], "write NAME=VALUES"),
        (["own.py", "--set", "mass=1", "--set", "mass=2"], "given twice"),
        (["own.py", "--set", "mas=1"], "did you mean 'mass'"),
        (["own.py", "--measure", "lowst"], "unknown measure 'lowst'"),
        (["own.py", "--seed", "a"], "--seed must be whole numbers"),
        (["own.py", "--seed", "0..999999"], "1,000,000 combinations: say --yes"),
        (["chain", "--seed", "1"], "nothing random"),
        (["own.py", "--out", "no/s.parquet"], "no does not exist"),
        (["own.py", "--workers", "0"], "workers must be at least 1"),
        (["plot", "own.py", "--x", "a", "--y", "b"], "is no study"),
    ],
)
def test_bad_usage(own, call, args, message):
    code, _, err = call("study", *args)
    assert code == 2
    assert message in err
    assert "Traceback" not in err


def start(*args):
    command = [sys.executable, "-c", "from pbd_warp.cli import main; main()", "study", *args]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)


def rows_kept(path):
    journal = path.with_name(path.name + ".rows")
    there = len(journal.read_bytes().split(b"\n")) - 2 if journal.exists() else 0
    return max(there, 0) + (len(load(path)) if path.exists() else 0)


def wait_for(path, count):
    until = time.monotonic() + 60.0
    while rows_kept(path) < count:
        assert time.monotonic() < until
        time.sleep(0.02)


def test_killed_and_interrupted_studies_go_on(own, cluster, call, tmp_path):
    out = tmp_path / "s.parquet"
    command = ("own.py", "--set", "slow=0.05", "--seed", "0..59", "--measure", "energy", "--out", str(out))
    process = start(*command, "--scheduler", address(cluster))
    wait_for(out, 5)
    process.kill()
    process.wait()
    kept = rows_kept(out)
    assert 5 <= kept < 60
    process = start(*command, "--workers", "2")
    wait_for(out, kept + 5)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    err = process.communicate(timeout=30)[1]
    assert process.returncode == 130, err
    assert "interrupted" in err
    assert "Traceback" not in err
    assert [path.name for path in tmp_path.glob("s.*")] == ["s.parquet"]
    assert kept + 5 <= len(load(out)) < 60
    assert call("study", *command, "--scheduler", address(cluster))[0] == 0
    rows, whole = load(out), pbd.study(own, {"slow": 0.0}, ["energy"], seed=range(60), scheduler=address(cluster))
    assert rows["energy"].equals(whole["energy"])


TINY = """
import sys, warp as wp
from pbd_warp.kernel_cache import load_module
@wp.kernel
def tiny(x: wp.array[float]):
    x[wp.tid()] = 1.0
wp.init()
print("ready", flush=True)
sys.stdin.readline()
load_module(tiny.module.name, wp.get_device("cpu"))
"""


def test_kernels_are_compiled_once_for_all_processes_that_start_together(tmp_path):
    (tmp_path / "tiny.py").write_text(TINY)
    environment = os.environ | {"WARP_CACHE_PATH": str(tmp_path / "cache")}
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import tiny"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    processes = [subprocess.Popen(command, env=environment, **pipes) for _ in range(3)]
    for process in processes:
        while process.stdout.readline().strip() != "ready":
            assert process.poll() is None
    said = []
    for process in processes:
        process.stdin.write("go\n")
        process.stdin.flush()
    said = [process.communicate(timeout=60)[0] for process in processes]
    assert [sum("(compiled)" in text for text in said), sum("(cached)" in text for text in said)] == [1, 2], said
