"""What the tests of methods share."""

import numpy as np
import pytest

import pbd_warp as pbd

EPS = {"float32": float(np.finfo(np.float32).eps), "float64": float(np.finfo(np.float64).eps)}
both_precisions = pytest.mark.parametrize("dtype", EPS)


def run(model, frames=1, check=None, **settings):
    """A simulation after some frames; `check` sees it after each."""
    sim = pbd.Simulation(model, **settings)
    for _ in range(frames):
        sim.step()
        if check is not None:
            check(sim)
    return sim


def converged(sim):
    assert sim.unconverged == 0


def rope_between(positions, masses, pinned, dtype="float64", **kwargs):
    builder = pbd.ModelBuilder()
    builder.add_rope(positions, mass=masses, pinned=pinned, **kwargs)
    return builder.finalize(dtype=dtype)
