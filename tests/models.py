"""Small models that several tests build."""

from itertools import pairwise

import numpy as np
from pxr import Usd, UsdGeom

import pbd_warp as pbd

FOUR_SCENES = ("worm", "collision", "point", "rope")
"""Those with a drag; the others are for studies, with a reference."""


def rope_model(n=6, dtype="float64", gravity=(0, -9.81, 0), pinned=(0,), **kwargs):
    builder = pbd.ModelBuilder(gravity=gravity)
    x = np.linspace(0.0, 1.0, n)
    builder.add_rope(np.stack([x, 0 * x, 0 * x], axis=1), pinned=pinned, **kwargs)
    return builder.finalize(dtype=dtype)


def crowd_model(rng, n=30, dtype="float64", joined=True, speed=3.0):
    """Particles of many sizes in a small space, some overlapping, some fixed, some joined, two colliders."""
    builder = pbd.ModelBuilder()
    positions = rng.uniform(-0.5, 0.5, (n, 3))
    radius = rng.uniform(0.02, 0.15, n)
    radius[0] = 0.0
    mass = rng.choice([0.0, 0.5, 1.0, 3.0], n)
    velocity = np.where(mass[:, None] > 0.0, rng.normal(size=(n, 3)) * speed, 0.0)
    builder.add_particles(positions, velocity, mass, radius)
    if joined:
        builder.add_distances([(i, i + 1) for i in range(0, n - 1, 3)])
    builder.add_plane((0, -0.6, 0), (0.1, 1, 0), friction=0.3, restitution=0.5)
    builder.add_sphere((0.1, 0.2, 0.0), 0.2, friction=0.2)
    builder.enable_contacts(friction=0.4, restitution=0.7)
    return builder.finalize(dtype=dtype)


def heap_model(rng, ropes=12, length=14, speed=3.0, dtype="float64", **contacts):
    """Ropes that lie across each other in a small space, some overlapping, a few balls among them."""
    builder = pbd.ModelBuilder()
    for _ in range(ropes):
        turn = rng.normal(size=(length + 1, 3)) * 0.5 + rng.normal(size=3)
        step = 0.05 * turn / np.linalg.norm(turn, axis=1, keepdims=True)
        x = np.cumsum(step, axis=0)
        x += rng.uniform(-0.1, 0.1, 3) - x.mean(axis=0)
        rope = builder.add_particles(x, rng.normal(size=x.shape) * speed, mass=0.1, radius=rng.uniform(0.01, 0.02))
        for i, j in pairwise(rope):
            builder.add_distance(i, j)
    builder.add_particles(rng.uniform(-0.2, 0.2, (6, 3)), rng.normal(size=(6, 3)) * speed, mass=0.02, radius=0.03)
    builder.add_particles(rng.uniform(-0.3, 0.3, (3, 3)))  # of no size: nothing touches them
    builder.enable_contacts(**{"links": True, "friction": 0.3, **contacts})
    return builder.finalize(dtype=dtype)


def state(sim):
    """Positions and velocities as float64."""
    return sim.state.x.numpy().astype(np.float64), sim.state.v.numpy().astype(np.float64)


def samples(path):
    """Time codes of the particles' positions in a USD file."""
    stage = Usd.Stage.Open(str(path))  # held, or its prims would go with it
    return UsdGeom.Points.Get(stage, "/World/Particles").GetPointsAttr().GetTimeSamples()
