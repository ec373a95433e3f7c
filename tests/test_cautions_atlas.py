"""What is said to fail before a run is what failed in the runs of the atlas."""

import csv
from pathlib import Path

import pytest

import pbd_warp as pbd
from pbd_warp.preflight import preflight
from pbd_warp.stability.cell import study
from pbd_warp.stability.maps import MAPS

ATLAS = Path(__file__).parents[1] / "docs" / "stability"
SCENES = {
    "mass_ratio": lambda x: study("heavy_bob", ratio=x),
    "chain_length": lambda x: study("long_rope", links=int(x)),
}


@pytest.mark.parametrize("name", SCENES)
def test_the_estimated_stretch_is_that_of_the_atlas(name):
    """Every fourth cell of the sweeping methods: right but at the boundary, where the estimate may be 4 times off."""
    with open(ATLAS / f"{name}.csv") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    wrong = right = 0
    for row in [row for row in rows if "direct" not in row["panel"]][::4]:
        sweeps, method = int(float(row["y"])), pbd.Jacobi if "jacobi" in row["panel"] else pbd.GaussSeidel
        iterations, substeps = (1, sweeps) if "steps of 1" in row["panel"] else (sweeps, 1)
        scene = SCENES[name](float(row["x"])).changed(method=method(iterations), substeps=substeps, integrator="pbd")
        sim = pbd.Simulation(scene.builder.finalize(), scene.settings)
        severity = max(c.severity for c in preflight(sim._snapshot()) if c.test in SCENES)
        fails = row["outcome"] != "converged"
        if fails == (severity > 1.0):
            right += 1
        else:
            wrong += 1
            assert 0.25 < severity < 4.0, row
    assert right > 9 * wrong > 0 or wrong == 0


def test_every_caution_is_a_map():
    from test_guard_rails import KNOWN_TO_FAIL

    assert set(KNOWN_TO_FAIL) <= set(MAPS)
