"""A net, held by one corner, or taut between two.

Distance constraints in closed meshes, and gravity. One should see the net swing down and fold about its corner; held by
two it sags between them, the upper edge as straight as its links allow: no length of it can give.
"""

import numpy as np

import pbd_warp as pbd

SIZE = 1.0  # m


def scene(side: int = 10, corners: int = 1) -> pbd.Scene:
    """side: Particles along each side. corners: Held, 1 or 2."""
    if side < 2 or corners not in (1, 2):
        raise pbd.InputError("a net has a side of 2 particles or more, and is held by 1 or 2 corners")
    x, y = np.meshgrid(np.linspace(0.0, SIZE, side), np.linspace(0.0, -SIZE, side))
    number = np.arange(side * side).reshape(side, side)
    edges = np.concatenate(
        [
            np.stack([number[:, :-1].ravel(), number[:, 1:].ravel()], axis=1),
            np.stack([number[:-1].ravel(), number[1:].ravel()], axis=1),
        ]
    )
    builder = pbd.ModelBuilder()
    places = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
    builder.add_graph(places, edges, mass=0.2, pinned=(0, side - 1)[:corners], radius=0.01)
    return pbd.Scene(builder, frames=120, substeps=4, method=pbd.Direct(), on_failure="continue")
