"""What goes wrong around a command is noticed and said, and nothing that was there is lost."""

import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from campaign.inputs import OWN
from campaign.processes import Processes
from models import rope_model

import pbd_warp as pbd
from pbd_warp.paths import animation_files, check_apart, check_file
from pbd_warp.run import Checkpoints, Hooks, run

STAGE = Path(__file__).parent / "data" / "cables_blender.usda"

pytestmark = pytest.mark.skipif(os.name == "nt", reason="commands in forked processes")


@pytest.fixture(scope="module")
def processes():
    with Processes(("worm",)) as made:
        yield made


@pytest.fixture
def folder(tmp_path):
    shutil.copy(STAGE, tmp_path / "in.usda")
    (tmp_path / "own.py").write_text(OWN)
    return tmp_path


def listing(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


# Whose a file is.

WORM = ("run", "worm", "--out", "a.usdc", "--checkpoint", "c.npz", "--every", 10)


@pytest.mark.parametrize(
    ("between", "said"),
    [
        ("run worm --out a.usdc --frames 60 --damping 0.3", "a.usdc is of another run, as it differs in settings"),
        (
            "run rope --out a.usdc --frames 60",
            "a.usdc is of another run, as it differs in model and settings and drags",
        ),
        ("run worm --out a.usdc --frames 9", "holds 9 frames, fewer than the 20 to go on from"),
    ],
)
def test_frames_of_another_run_are_not_gone_on_from(processes, folder, between, said):
    assert processes.call(*WORM, "--frames", 25, cwd=folder).code == 0
    assert processes.call(*between.split(), cwd=folder).code == 0
    before = listing(folder)
    ended = processes.call(*WORM, "--frames", 50, "--resume", cwd=folder)
    assert ended.code == 2
    assert said in ended.err
    assert listing(folder) == before


@pytest.mark.parametrize(
    ("edit", "said"),
    [
        (
            lambda text: text.replace("#usda 1.0", "#usda 1.0\n# edited"),
            "c.npz is of another run, as it differs in stage",
        ),
        (lambda text: text, ""),
    ],
)
def test_a_stage_edited_since_is_noticed(processes, folder, edit, said):
    command = ["simulate", "in.usda", "--out", "a.usda", "--checkpoint", "c.npz", "--every", 5, "--mass", 1]
    assert processes.call(*command, "--frames", 8, cwd=folder).code == 0
    (folder / "in.usda").write_text(edit(STAGE.read_text()))
    ended = processes.call(*command, "--frames", 12, "--resume", cwd=folder)
    assert ended.code == (2 if said else 0), ended.err
    assert said in ended.err


# The files of a command.


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("run worm --frames 3 --out a.usda --checkpoint a.usda", "--out and --checkpoint are both a.usda"),
        ("run worm --frames 3 --out a.usda --checkpoint ./a.partial.usda", "--out and --checkpoint are both"),
        ("run worm --frames 3 --out a.usda --stats a.partial.usda.frames", "--out and --stats are both"),
        ("run worm --frames 3 --out a.usda --stats a.usda", "--out and --stats are both a.usda"),
        ("run worm --frames 3 --out a.usda --stats s --checkpoint ../{name}/s", "--checkpoint and --stats are both"),
        ("run own.py --frames 3 --stats own.py", "--stats and the scene are both own.py"),
        ("run own.py --frames 3 --checkpoint link", "--checkpoint and the scene are both"),
        (
            "run own.py --frames 3 --checkpoint hard",
            "are both own.py, which hard would spoil",
        ),
        ("simulate in.usda --out in.usda", "--out and the stage are both in.usda"),
        ("simulate in.usda --out a.usda --checkpoint in.usda", "--checkpoint and the stage are both"),
        ("simulate in.usda --out a.usda --stats in.usda", "--stats and the stage are both"),
        ("simulate a.partial.usda --out a.usda", "--out and the stage are both a.partial.usda"),
        ("simulate over.usda --out a.usda --stats in.usda", "--stats and the stage are both"),
        ("simulate over.usda --out in.usda", "--out and the stage are both"),
        ("chart own.py --out c.svg --csv own.py", "--csv and the scene are both own.py"),
        ("view own.py --no-open --record own.py", "--record and the scene are both own.py"),
    ],
)
def test_no_file_is_two_things(processes, folder, command, said):
    (folder / "link").symlink_to("own.py")
    os.link(folder / "own.py", folder / "hard")
    shutil.copy(STAGE, folder / "a.partial.usda")
    (folder / "over.usda").write_text("#usda 1.0\n(subLayers = [@./in.usda@])\n")
    before = listing(folder)
    ended = processes.call(*command.format(name=folder.name).split(), cwd=folder)
    assert ended.code == 2, ended.err
    assert said in ended.err
    assert listing(folder) == before
    assert (folder / "link").is_symlink()


def test_the_api_checks_the_paths_too(tmp_path):
    scene = pbd.load_scene("worm").changed(frames=3)
    with pytest.raises(pbd.InputError, match="the output and the checkpoint are both"):
        run(scene, tmp_path / "a.usda", hooks=Hooks(checkpoints=Checkpoints(tmp_path / "a.partial.usda")))
    check_apart({"a": [tmp_path / "x"]}, {"b": animation_files(tmp_path / "y.usda")})


@pytest.mark.parametrize(
    ("name", "said"),
    [("a\nb", "line breaks"), ("a\udcffb", "no name in UTF-8"), ("x" * 250, "too long"), ("", "is a folder")],
)
def test_names_that_no_file_should_have(tmp_path, name, said):
    with pytest.raises(pbd.InputError, match=said):
        check_file(tmp_path / name)


def test_devices_are_not_replaced():
    with pytest.raises(pbd.InputError, match="/dev/null is not an ordinary file"):
        check_file(Path("/dev/null"))


def test_links_are_written_through(processes, folder):
    (folder / "there").mkdir()
    for name in ("a.usda", "c.npz", "s.json"):
        (folder / name).symlink_to(f"there/{name}")
    command = "run worm --frames 9 --out a.usda --checkpoint c.npz --every 4 --stats s.json"
    assert processes.call(*command.split(), cwd=folder).code == 0
    assert sorted(path.name for path in (folder / "there").iterdir()) == ["a.usda", "c.npz", "s.json"]
    assert all((folder / name).is_symlink() for name in ("a.usda", "c.npz", "s.json"))


def test_two_runs_to_one_name_at_once(folder):
    """One of them writes it, and the other says so and leaves nothing."""
    code = "from pbd_warp.cli import main; main()"
    line = [sys.executable, "-c", code, "run", "worm", "--frames", "400", "--out", "a.usdc", "--checkpoint", "c.npz"]
    both = [subprocess.Popen(line, cwd=folder, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    errors = [process.communicate()[1] for process in both]
    codes = sorted(process.returncode for process in both)
    if codes != [0, 0]:  # they may also have come one after the other
        assert codes == [0, 2]
        assert any("another run is writing to" in error for error in errors)
    assert sorted(path.name for path in folder.iterdir()) == ["a.usdc", "c.npz", "in.usda", "own.py"]


# Sentences.


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("run worm --fps 1e308", "fps must be a finite number in 1e-06..1e+09, not 1e+308"),
        ("run worm --fps 1e-300", "fps must be a finite number in 1e-06..1e+09, not 1e-300"),
        ("run worm --substeps 2147483648", "substeps must be at most 1000000, not 2147483648"),
        ("run worm --iterations 2147483648", "iterations must be at most 1000000, not 2147483648"),
        ("run worm --max-contacts 2147483648", "max_contacts must be at most 268435456"),
        ("run worm --every -1", "--every must be at least 1, not -1"),
        ("run worm --dtype=", "Invalid value for '--dtype': it is empty"),
        ("run worm --stats nowhere/s.json", "nowhere does not exist"),
        ("run worm --stats .", ". is a folder"),
        ("run worm --out /dev/full/a.usda", "does not exist"),
    ],
)
def test_bad_input_is_said_in_a_sentence(processes, folder, command, said):
    before = listing(folder)
    ended = processes.call(*command.split(), cwd=folder)
    assert ended.code == 2
    assert said in ended.last_line
    assert listing(folder) == before


def test_what_is_hopeless_is_said_before_it_starts():
    said = []
    scene = pbd.load_scene("worm").changed(frames=1, method=pbd.Jacobi(3), substeps=400_000, capture=False)

    class Stop(Exception):
        pass

    def stop(sentence):
        said.append(sentence)
        raise Stop

    with pytest.raises(Stop):
        run(scene, Path("never.usda"), hooks=Hooks(on_start=stop))
    assert "each frame takes 1e+09 projections of constraints, which is minutes or more" in said[0]


BREAKS = (
    "import pbd_warp.cli.run as module\ndef broken(*a, **k): raise {error}\nmodule.run = broken\n"
    "from pbd_warp.cli import main\nmain()"
)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (
            "KeyError('frob')",
            "pbd-warp: KeyError: 'frob' (this should have been a clearer sentence; --debug",
        ),
        ("MemoryError()", "pbd-warp: there is not enough memory for this\n  helps: make the scene smaller"),
        ("OSError('a\\x1b[31m\\nb')", r"pbd-warp: a\x1b[31m\nb"),
    ],
)
def test_what_nobody_foresaw_is_a_sentence_too(processes, folder, error, said):
    ended = processes.call("run", "worm", cwd=folder, code=BREAKS.format(error=error))
    assert ended.code == 1
    assert ended.err.strip().startswith(said)
    assert "Traceback" not in ended.err
    ended = processes.call("run", "worm", "--debug", cwd=folder, code=BREAKS.format(error=error))
    assert "Traceback" in ended.err


def test_nobody_reads_the_table(folder):
    code = "from pbd_warp.cli import main; main()"
    line = [sys.executable, "-c", code, "run", "worm", "--frames", "3", "--out", "a.usda"]
    reader, writer = os.pipe()
    os.close(reader)
    result = subprocess.run(line, cwd=folder, stdout=writer, stderr=subprocess.PIPE, text=True)
    os.close(writer)
    assert (result.returncode, "Broken" in result.stderr) == (0, False), result.stderr
    assert (folder / "a.usda").exists()


# The kernel cache.

STEP = "import pbd_warp as pbd; b = pbd.ModelBuilder(); b.add_particle((0, 0, 0)); pbd.Simulation(b.finalize()).step()"


def step_with(cache):
    environment = {**os.environ, "WARP_CACHE_PATH": str(cache)}
    root = Path(__file__).parents[1]
    return subprocess.run([sys.executable, "-c", STEP], env=environment, cwd=root, capture_output=True, text=True)


def test_a_damaged_kernel_cache_is_made_again(tmp_path):
    assert step_with(tmp_path).returncode == 0
    for suffix in ("o", "meta"):
        files = list(tmp_path.rglob(f"*.{suffix}"))
        assert files
        for file in files:
            os.truncate(file, 3)
        result = step_with(tmp_path)
        assert result.returncode == 0, result.stderr
        assert all(file.stat().st_size > 3 for file in files)


def test_a_kernel_cache_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    result = step_with(tmp_path / "file")
    assert "set WARP_CACHE_PATH" in result.stderr.strip().splitlines()[-1]


# Simulations.


@pytest.mark.parametrize("name", ["dt", "substeps", "damping", "method", "integrator", "settings", "model", "time"])
def test_settings_are_read_only(name):
    sim = pbd.Simulation(rope_model())
    with pytest.raises(AttributeError, match=rf"{name} is read-only, .* like\(...\) and continue_with\(...\)"):
        setattr(sim, name, 1)


def test_a_thread_waits_while_another_records_a_frame():
    from pbd_warp.step.launch import RECORDING

    model, made = rope_model(), []
    thread = threading.Thread(target=lambda: made.append(pbd.Simulation(model)))
    with RECORDING:
        thread.start()
        thread.join(0.2)
        assert made == []
    thread.join()
    assert len(made) == 1


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
def test_a_model_is_copied_and_a_simulation_says_what_to_do(way):
    import copy
    import pickle

    copied = copy.deepcopy if way == "deepcopy" else lambda value: pickle.loads(pickle.dumps(value))
    model = rope_model()
    sims = [pbd.Simulation(each) for each in (model, copied(model))]
    for sim in sims:
        sim.step()
    np.testing.assert_array_equal(*(sim.state.x.numpy() for sim in sims))
    with pytest.raises(TypeError, match=r"save\(path\) and Simulation.load\(path\)"):
        copied(sims[0])
