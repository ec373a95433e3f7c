"""Rods for tests of bending."""

import numpy as np

import pbd_warp as pbd
from pbd_warp.accuracy import rods

G = 9.81


def rod(x, mass, bending, pinned=(0, 1), gravity=(0, -G, 0), dtype="float64", **kwargs):
    builder = pbd.ModelBuilder(gravity=gravity)
    builder.add_rope(x, mass=mass, pinned=pinned, bending=bending, **kwargs)
    return builder.finalize(dtype=dtype)


def cantilever(links, bending=1.0, tip=0.0, weight=0.0, angle=0.0):
    """A straight rod of 1 m, clamped in the middle of its first link; tip: force [N], weight: of it all [N]."""
    s = rods.clamped(links, 1.0)
    mass = np.full(links + 1, max(weight, 1e-4 * tip) / G * (s[1] - s[0]))
    mass[-1] = 0.5 * mass[-1] + tip / G
    return rod(s[:, None] * [np.cos(angle), np.sin(angle), 0.0], mass, bending)


def at_rest(model, dt=3.0, frames=40):
    """Where a model comes to rest: steps of "pbd" so long that nothing swings."""
    sim = pbd.Simulation(model, method=pbd.Direct(), dt=dt)
    for _ in range(frames):
        sim.step()
    assert np.abs(sim.velocities).max() < 1e-7
    return sim


def orders(errors):
    """Of errors at doubled numbers of links."""
    return np.log2(np.abs(errors[:-1]) / np.abs(errors[1:]))
