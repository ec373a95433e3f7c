"""Discs in a walled box: some fly about, one is grabbed and pushes the others.

The inequality constraint acts only where discs touch. One should see discs bounce off each other and off the walls,
the grabbed one plough through the rest, and no two overlap.
"""

import numpy as np

import pbd_warp as pbd

WIDTH, HEIGHT = 2.0, 1.4  # m


def scene(seed: int = 1) -> pbd.Scene:
    """`seed` draws the radii and the velocities."""
    rng = np.random.default_rng(seed)
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    columns, rows = 7, 5
    gx = (np.arange(columns) + 0.5) * WIDTH / columns
    gy = (np.arange(rows) + 0.5) * HEIGHT / rows
    centre = np.array([(x, y, 0.0) for x in gx for y in gy])
    radius = rng.uniform(0.05, 0.09, len(centre))
    moving = rng.random(len(centre)) < 0.4
    angle = rng.uniform(0.0, 2.0 * np.pi, len(centre))
    velocity = 0.8 * moving[:, None] * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    mass = 40.0 * np.pi * radius**2  # discs of 40 kg/m^2
    discs = builder.add_particles(centre, velocity, mass, radius)

    for point, normal in (
        ((0, 0, 0), (1, 0, 0)),
        ((WIDTH, 0, 0), (-1, 0, 0)),
        ((0, 0, 0), (0, 1, 0)),
        ((0, HEIGHT, 0), (0, -1, 0)),
    ):
        builder.add_plane(point, normal, restitution=0.5)
    builder.enable_contacts(friction=0.1, restitution=0.5)

    grabbed = discs[len(centre) // 2]
    drag = [
        (1.0, "select", grabbed),
        (1.6, "move", (0.5, 1.0, 0)),
        (2.4, "move", (0.4, 0.4, 0)),
        (3.4, "move", (1.6, 0.4, 0)),
        (4.0, "move", (1.5, 1.0, 0)),
        (4.2, "deselect"),
    ]
    return pbd.Scene(builder, frames=300, substeps=16, method=pbd.Jacobi(iterations=4), drag=drag)
