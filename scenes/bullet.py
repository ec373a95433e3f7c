"""Bullets are fired at posts, each starting a little further back.

Contacts at high speed, no gravity. One should see every bullet stop at its post; a test for overlap at the ends of the
steps alone would let those through that are before their post in one step and behind it in the next.
"""

import numpy as np

import pbd_warp as pbd

RADIUS = 0.05  # m, of bullets and posts
TRACKS = 8


def scene(speed: float = 100.0) -> pbd.Scene:
    """`speed` of the bullets [m/s]."""
    fps = 60.0
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    y = 4.0 * RADIUS * np.arange(TRACKS)
    # The starts differ by parts of the way of one frame, so that some bullets are on the posts' far side after it.
    back = -3.0 * RADIUS - speed / fps * (np.arange(TRACKS) + 0.5) / TRACKS
    builder.add_particles(np.stack([back, y, 0 * y], axis=1), (speed, 0, 0), mass=0.01, radius=RADIUS)
    builder.add_particles(np.stack([0 * y, y, 0 * y], axis=1), mass=0.0, radius=RADIUS)
    builder.enable_contacts()
    return pbd.Scene(builder, frames=20, fps=fps, method=pbd.Jacobi(iterations=4))
