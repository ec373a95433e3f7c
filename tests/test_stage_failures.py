"""Curves in which Newton's method does not converge: named, and left where a run is not to go on with them."""

import numpy as np
import pytest
from pxr import Usd
from stages import add_curves, line, local, new_stage

import pbd_warp as pbd
from pbd_warp.curves import StageHooks, load_stage, simulate


@pytest.fixture
def hair(tmp_path, rng):
    """One hair hangs at rest, another one is crumpled: two iterations a step are too few for it now and then."""
    stage = new_stage(tmp_path / "hair.usda", last=60)
    crumpled = 0.1 * np.cumsum(rng.normal(size=(12, 3)), axis=0)
    down = line(12, (5, 0, 0), (5, -1, 0))
    add_curves(stage, "/World/Hair", np.concatenate([down, crumpled]), counts=[12, 12])
    stage.Save()
    return tmp_path / "hair.usda"


def source_of(path, **changes):
    return load_stage(path, dtype="float64").changed(method=pbd.Direct(iterations=2), substeps=1, **changes)


def test_a_hair_that_does_not_converge_is_named(hair, tmp_path):
    notes = []
    source = source_of(hair, on_failure="continue", limits=pbd.Limits(stretch=None))
    stats = simulate(source, tmp_path / "o.usda", hooks=StageHooks(on_note=notes.append))
    assert stats.unconverged > 0
    many = stats.unconverged
    start = f"{many} solutions did not converge, {many} of them of curve 1 of /World/Hair; links were stretched by "
    assert next(note for note in notes if "converge" in note).startswith(start)


def test_under_raise_a_hair_that_does_not_converge_is_left_and_the_others_are_kept(hair, tmp_path):
    notes = []
    simulate(source_of(hair, on_failure="raise"), tmp_path / "o.usda", hooks=StageHooks(on_note=notes.append))
    assert notes[0].startswith("curve 1 of /World/Hair left as in the input, as the simulation failed: frame ")
    assert "did not converge in 1 solution, most often of what is joined to point 1 of curve 1 of /World/H" in notes[0]
    result, before = Usd.Stage.Open(str(tmp_path / "o.usda")), Usd.Stage.Open(str(hair))
    shown, given = (local(stage, "/World/Hair", 60)[12:] for stage in (result, before))
    np.testing.assert_array_equal(shown, given)
    with pytest.raises(pbd.SimulationFailed, match=r"joined to point 1 of curve 1 of /World/Hair"):
        simulate(source_of(hair, on_failure="raise"), tmp_path / "o.usda", strict=True)
