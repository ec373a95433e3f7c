"""A rope, locked at one end, falls from the horizontal, whips and comes to hang.

Distance and point constraints and gravity. One should see it swing down and whip at its tip, and swing on with ever
less inner motion; as it turns back at 4.65 s the grabber takes the tip, leads it under the pin and lets go, and the
rope hangs straight and still.
"""

import numpy as np

import pbd_warp as pbd

LINKS = 20
LENGTH = 1.0  # m


def scene() -> pbd.Scene:
    builder = pbd.ModelBuilder()
    x = np.linspace(0.0, LENGTH, LINKS + 1)
    rope = builder.add_rope(
        np.stack([x, 0 * x, 0 * x], axis=1), mass=[0.2 / (LINKS + 1)] * (LINKS + 1), pinned=(), radius=0.01
    )
    builder.add_point(rope[0], target=(0.0, 0.0, 0.0))
    # Takes the tip where it turns back, some 64 degrees to the left, and leads it down, never quite taut.
    time = np.linspace(0.0, 2.0, 61)
    angle = -1.111 * 0.5 * (1.0 + np.cos(np.pi * time / 2.0))
    path = 0.985 * LENGTH * np.stack([np.sin(angle), -np.cos(angle), 0.0 * angle], axis=1)
    drag = [
        (4.65, "select", rope[-1]),
        *((4.65 + t, "move", p) for t, p in zip(time[1:], path[1:], strict=True)),
        (7.65, "move", (0.0, -0.997 * LENGTH, 0.0)),
        (8.15, "deselect"),
    ]
    return pbd.Scene(builder, frames=600, substeps=48, method=pbd.GaussSeidel(iterations=1), damping=0.05, drag=drag)
