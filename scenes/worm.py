"""A worm is led by its head along a figure of eight, and all its particles follow.

Distance constraints, no gravity: nothing pulls the worm but the grabber. One should see the head run ahead on its
path, the body come after it link by link without stretching, and the whole worm drift on when the head is let go.
"""

import numpy as np

import pbd_warp as pbd

LINKS = 24
LENGTH = 1.2  # m
ROUND = 4.4  # s, once along the eight


def scene() -> pbd.Scene:
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    x = np.linspace(0.0, -LENGTH, LINKS + 1)
    worm = builder.add_rope(np.stack([x, 0 * x, 0 * x], axis=1), mass=[0.25 / len(x)] * len(x), pinned=(), radius=0.012)

    # A figure of eight (a Lissajous curve), taken up and ended gently.
    time = np.linspace(0.0, ROUND, 151)
    turn = 2.0 * np.pi * time / ROUND - np.sin(2.0 * np.pi * time / ROUND)
    path = np.stack([0.45 * np.sin(turn), 0.25 * np.sin(2.0 * turn), 0.0 * turn], axis=1)
    drag = [
        (0.25, "select", worm[0]),
        *((0.25 + t, "move", p) for t, p in zip(time[1:], path[1:], strict=True)),
        (4.75, "deselect"),
    ]
    return pbd.Scene(builder, frames=300, substeps=32, method=pbd.GaussSeidel(iterations=1), damping=0.2, drag=drag)
