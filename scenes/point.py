"""A chain whose first particle is locked to the origin, led about by its last.

Point and distance constraints, no gravity. One should see the chain turn about the origin as its end is led once
around; then the grabber goes further than the chain can reach: the chain stretches straight, and is whole again when
the grabber comes back.
"""

import numpy as np

import pbd_warp as pbd

LINKS = 10
LENGTH = 1.0  # m
ROUND = 2.6  # s, once around the origin


def scene() -> pbd.Scene:
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    x = np.linspace(0.0, LENGTH, LINKS + 1)
    chain = builder.add_rope(
        np.stack([x, 0 * x, 0 * x], axis=1), mass=[0.5 / (LINKS + 1)] * (LINKS + 1), pinned=(), radius=0.02
    )
    builder.add_point(chain[0], target=(0.0, 0.0, 0.0))

    time = np.linspace(0.0, ROUND, 91)
    angle = np.pi * (1.0 - np.cos(np.pi * time / ROUND))
    reach = LENGTH * (0.95 + 0.05 * np.cos(angle))  # a little slack on the far side
    path = np.stack([reach * np.cos(angle), reach * np.sin(angle), 0.0 * angle], axis=1)
    drag = [
        (0.2, "select", chain[-1]),
        *((0.2 + t, "move", p) for t, p in zip(time[1:], path[1:], strict=True)),
        (3.4, "move", (1.3 * LENGTH, 0.0, 0.0)),
        (3.7, "move", (1.3 * LENGTH, 0.0, 0.0)),
        (4.4, "move", (0.8 * LENGTH, 0.3 * LENGTH, 0.0)),
        (4.5, "deselect"),
    ]
    return pbd.Scene(builder, frames=300, substeps=32, method=pbd.Jacobi(iterations=4), damping=0.1, drag=drag)
