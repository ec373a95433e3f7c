"""`pbd-warp simulate` goes on from a checkpoint to the same file."""

from pathlib import Path

import pytest
from test_cli import call, last_line

import pbd_warp as pbd

STAGE = Path(__file__).parent / "data" / "cables_blender.usda"


@pytest.mark.parametrize("flatten", [False, True])
def test_a_resumed_stage_ends_as_if_it_never_stopped(tmp_path, flatten):
    (tmp_path / "in.usda").write_bytes(STAGE.read_bytes())
    simulate = ["simulate", "in.usda", "--prim", "/root/Vines*", "--substeps", 2, *(["--flatten"] if flatten else [])]
    kept = [*simulate, "--out", "r.usda", "--checkpoint", "c.npz", "--every", 40]
    for arguments in ([*simulate, "--out", "w.usda", "--frames", 75], [*kept, "--frames", 50]):
        result = call(*arguments, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
    assert pbd.Simulation.load(tmp_path / "c.npz").frame == 39
    result = call(*kept, "--frames", 75, "--resume", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert (tmp_path / "r.usda").read_bytes() == (tmp_path / "w.usda").read_bytes()


def test_a_stage_that_has_changed_is_refused(tmp_path):
    text = STAGE.read_text()
    (tmp_path / "in.usda").write_text(text)
    kept = ["simulate", "in.usda", "--out", "r.usda", "--checkpoint", "c.npz", "--every", 4, "--frames"]
    assert call(*kept, 6, cwd=tmp_path).returncode == 0
    result = call(*kept, 12, "--resume", "--mass", 7, cwd=tmp_path)
    assert result.returncode == 2
    assert "is of another model: its w is not the same" in last_line(result.stderr)
