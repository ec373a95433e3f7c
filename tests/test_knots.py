"""Known answers of ropes that lie on each other, and of a knot, by Newton's method."""

from itertools import pairwise

import numpy as np
import pytest

import pbd_warp as pbd

LENGTH = 2.0  # m: of the scene's rope


def crossing_ropes(upper_load):
    """Two springy ropes at right angles, held at their ends, the upper one with a load in its middle."""
    builder = pbd.ModelBuilder()
    mass, links, radius = 0.01, 5, 0.008
    ropes = []
    for height, way in (0.0, (1, 0, 0)), (2 * radius, (0, 0, 1)):
        x = np.linspace(-0.25, 0.25, links + 1)[:, None] * way + np.array([0, height, 0])
        m = np.full(links + 1, mass)
        m[[0, -1]] = 0.0
        if height > 0.0:
            m[2:4] += upper_load / 2
        ropes.append(builder.add_particles(x, mass=m, radius=radius))
        for i, j in pairwise(ropes[-1]):
            builder.add_distance(i, j, compliance=1e-4)
    builder.enable_contacts(links=True, friction=0.3)
    return builder.finalize(dtype="float64"), ropes


def test_ropes_that_cross_share_a_load():
    """They sag alike, so each carries half of it: and the upper one lies on the lower one."""
    load = 1.0
    model, ropes = crossing_ropes(load)
    sim = pbd.Simulation(model, method=pbd.Direct(), substeps=1, damping=1.0)
    sim.step(frames=400)
    assert pbd.measure(sim).kinetic < 1e-8
    y = sim.positions[:, 1]
    sag = [y[rope[2:4]].mean() for rope in ropes]
    assert sag[0] < -0.01
    assert sag[1] - sag[0] == pytest.approx(2 * 0.008, rel=1e-6)
    lower, upper = (sim.forces.reaction[rope, 1].sum() for rope in ropes)
    # 2 F = (m_1 + m_2 + load) g
    assert lower == pytest.approx(upper, rel=1e-3)
    assert lower + upper == pytest.approx(9.81 * (load + 8 * 0.01), rel=1e-3)


def test_an_overhand_knot_is_pulled_tight_and_holds():
    """It takes 0.2 m of the rope for as long as no strand passes through another: then the rope would be straight."""
    scene = pbd.load_scene("knot")
    sim = pbd.Simulation(scene.builder.finalize(), scene.settings)
    sim.watch_crossings()
    x = sim.positions
    first = np.linalg.norm(x[-1] - x[0])
    deepest = 0.0
    for _ in range(90):
        sim.step()
        deepest = max(deepest, pbd.measure(sim).overlap)
    x = sim.positions
    apart = np.linalg.norm(x[-1] - x[0])
    assert first + 0.5 < apart < LENGTH - 0.15
    assert sim.crossings == []
    assert deepest < 0.01 * sim.model.radius[0]
