"""All particles start in one and the same place.

Constraints without any direction to act along, no gravity. One should see a chain fold out along a line until every
link has its length, or a heap of discs part until none overlap; and nothing that is not a number.
"""

import numpy as np

import pbd_warp as pbd

LENGTH = 0.1  # m, of a link; the diameter of a disc


def scene(count: int = 8, joined: int = 1) -> pbd.Scene:
    """`count` of the particles; `joined`: 1 a chain, 0 discs that touch."""
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    particles = builder.add_particles(np.zeros((count, 3)), mass=1.0, radius=0.5 * LENGTH if not joined else 0.01)
    if joined:
        builder.add_distances([(i, i + 1) for i in particles[:-1]], rest_length=LENGTH)
    else:
        builder.enable_contacts()
    room = count * count + 64
    return pbd.Scene(builder, frames=60, method=pbd.Jacobi(iterations=20), damping=0.2, max_contacts=room)
