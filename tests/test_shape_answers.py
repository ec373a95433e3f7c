"""Ropes on solids, against formulas: the capstan, Atwood's machine, a drum that turns, a ring on a cone."""

import numpy as np
import pytest
from meshes import grid

import pbd_warp as pbd

G = 9.81


def tube(radius, half, n=120):
    """A closed cylinder of triangles along z."""
    angle = np.append(2.0 * np.pi * np.arange(n) / n, 0.0)
    profile = [(0.0, half), (radius, half), (radius, -half), (0.0, -half)]
    rows = [np.stack([rho * np.cos(angle), rho * np.sin(angle), z + 0.0 * angle], axis=-1) for rho, z in profile]
    return grid(np.array(rows))


DRUMS = {
    "cylinder": lambda b, radius, mu: b.add_cylinder((0, 0, -0.5), (0, 0, 0.5), radius, friction=mu),
    "capsule": lambda b, radius, mu: b.add_capsule((0, 0, -0.5), (0, 0, 0.5), radius, friction=mu),
    "mesh": lambda b, radius, mu: b.add_mesh(*tube(radius, 0.5), friction=mu),
}


def over_a_drum(drum, left, right, mu, links=100, radius=0.2, thickness=0.005, spin=0.0, substeps=8):
    """A rope of 1 kg that hangs over a drum by these lengths on both sides, and is at rest."""
    builder = pbd.ModelBuilder(gravity=(0, -G, 0))
    bend = radius + thickness
    length = left + right + np.pi * bend
    s = np.linspace(0.0, length, links + 1)
    angle = np.pi - np.clip((s - left) / bend, 0.0, np.pi)
    x = bend * np.stack([np.cos(angle), np.sin(angle), 0.0 * s], axis=1)
    x[:, 1] -= np.maximum(left - s, 0.0) + np.maximum(s - left - np.pi * bend, 0.0)
    builder.add_rope(x, pinned=(), radius=thickness)
    number = DRUMS[drum](builder, radius, mu)
    if spin:
        builder.let_collider_move(number, angular_velocity=(0, 0, spin))
    sim = pbd.Simulation(builder.finalize(dtype="float64"), method=pbd.Direct(), substeps=substeps)
    return sim, bend, length


@pytest.mark.parametrize("drum", DRUMS)
def test_atwoods_machine(drum):
    """y'' = (2 g / L) y, with y half of what one side is longer."""
    sim, _, length = over_a_drum(drum, 0.5, 0.7, 0.0)
    start = sim.positions[0, 1]
    sim.step(frames=20)
    expected = 0.1 * np.cosh(np.sqrt(2.0 * G / length) * sim.time) - 0.1
    assert sim.positions[0, 1] - start == pytest.approx(expected, rel=0.03)  # a link, and the polygon's corners


@pytest.mark.parametrize("drum", DRUMS)
@pytest.mark.parametrize(("part", "slips"), [(0.9, False), (1.1, True)])
def test_where_a_rope_over_a_drum_begins_to_slide(drum, part, slips):
    """h2 = exp(mu pi) h1 + R 2 mu / (1 + mu^2) (exp(mu pi) + 1)."""
    mu, bend, short = 0.3, 0.205, 0.3
    grip = np.exp(mu * np.pi)
    limit = grip * short + bend * 2.0 * mu / (1.0 + mu * mu) * (grip + 1.0)
    sim, *_ = over_a_drum(drum, short, part * limit, mu)
    start = sim.positions[-1, 1]
    sim.step(frames=60)
    fallen = start - sim.positions[-1, 1]
    assert (fallen > 0.05) if slips else (abs(fallen) < 0.005)


@pytest.mark.parametrize("drum", DRUMS)
def test_a_turning_drum_takes_the_rope_along(drum):
    """Without slip while it holds: as far as the surface goes. It was at rest, so its first steps slip."""
    sim, bend, _ = over_a_drum(drum, 0.5, 0.5, 0.8, spin=-0.5)
    sim = sim.like(on_failure="subdivide")
    start = sim.positions
    sim.step(frames=30)
    way = 0.5 * bend * 0.5
    assert sim.positions[0, 1] - start[0, 1] == pytest.approx(way, rel=0.05)
    assert start[-1, 1] - sim.positions[-1, 1] == pytest.approx(way, rel=0.05)


@pytest.mark.parametrize("links", [24, 48])
def test_a_ring_on_a_cone_comes_to_rest_where_it_fits(links):
    """A closed ring of length L slides down a cone of half-angle a to where its own circle fits around it; its tension
    there is m g / (2 pi tan a)."""
    half_angle, ring, thickness = 0.5, 0.3, 0.004
    tan, cos = np.tan(half_angle), np.cos(half_angle)
    builder = pbd.ModelBuilder(gravity=(0, -G, 0))
    angle = 2.0 * np.pi * np.arange(links) / links
    x = np.stack([ring * np.cos(angle), 0.02 + 0.0 * angle, ring * np.sin(angle)], axis=1)
    # At the height 0 the ring, thickness off the surface along its normal, would just fit.
    surface = ring - thickness * cos
    apex = surface / tan - thickness * np.sin(half_angle)
    builder.add_graph(x, np.stack([np.arange(links), (np.arange(links) + 1) % links], axis=1), radius=thickness)
    builder.add_cone((0, apex - 2.0, 0), (0, apex, 0), 2.0 * tan)
    sim = pbd.Simulation(builder.finalize(dtype="float64"), method=pbd.Direct(), substeps=8, damping=0.2)
    sim.step(frames=90)
    np.testing.assert_allclose(sim.positions[:, 1], 0.0, atol=1e-3)
    chord = np.cos(np.pi / links)  # of the polygon: the pull of two links on a corner, over the circle's
    np.testing.assert_allclose(
        sim.tension, G / (2.0 * np.pi * tan) * np.pi / links / np.tan(np.pi / links) / chord, rtol=0.02
    )
