"""What scenes of ropes that touch promise to show, over their first second."""

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.measure import measure

THICK = {"pile": 0.009, "links": 0.006}


def run(name, dtype, frames=60):
    scene = pbd.load_scene(name)
    sim = pbd.Simulation(scene.builder.finalize(dtype=dtype), scene.settings)
    sim.watch_crossings()
    deepest = 0.0
    for _ in range(frames):
        sim.step()
        deepest = max(deepest, measure(sim).overlap)
    return sim, deepest


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_pile_lands_on_itself(dtype):
    sim, deepest = run("pile", dtype)
    assert sim.crossings == []
    assert deepest < 0.1 * THICK["pile"]
    height = sim.positions[:, 1]
    assert height.min() > 0.9 * THICK["pile"]
    assert np.count_nonzero(height > 2.5 * THICK["pile"]) > 20  # coils on coils
    assert np.linalg.norm(sim.velocities, axis=1).mean() < 0.05
    assert len(sim.link_pairs) > 100


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_links_stay_linked(dtype):
    sim, deepest = run("links", dtype)
    assert sim.crossings == []
    assert deepest < 0.1 * THICK["links"]
    rings = sim.positions.astype(float).reshape(5, -1, 3)
    start = sim.model.x.reshape(5, -1, 3)
    for k in range(4):
        number = pbd.linking_number(rings[k], rings[k + 1])
        assert abs(number) == pytest.approx(1.0, abs=1e-9)
        assert number == pytest.approx(pbd.linking_number(start[k], start[k + 1]), abs=1e-9)
    assert pbd.linking_number(rings[0], rings[2]) == pytest.approx(0.0, abs=1e-9)
    assert rings[4].mean(axis=0)[1] < start[4].mean(axis=0)[1] - 0.02  # it hangs lower than it began


def test_without_link_contacts_the_rings_fall_apart():
    scene = pbd.load_scene("links")
    scene.builder.enable_contacts()
    sim = pbd.Simulation(scene.builder, scene.settings)
    sim.watch_crossings()
    sim.step(60)
    assert sim.crossings
