"""Newton's cradle without strings: one ball hits a row of balls.

Contacts with restitution, no gravity. One should see, with restitution 1 and gaps between the balls, the last one fly
off with the speed of the first and all others at rest; balls that touch share a collision, and more than one flies off.
"""

import numpy as np

import pbd_warp as pbd

RADIUS = 0.1  # m
SPEED = 1.0  # m/s


def scene(balls: int = 5, restitution: float = 1.0, gap: float = 0.02) -> pbd.Scene:
    """`gap` between the balls that are hit [m]; 0: they touch."""
    x = (2.0 * RADIUS + gap) * np.arange(balls)
    x[0] -= 0.1
    velocity = np.zeros((balls, 3))
    velocity[0, 0] = SPEED
    builder = pbd.ModelBuilder(gravity=(0, 0, 0))
    builder.add_particles(np.stack([x, 0 * x, 0 * x], axis=1), velocity, mass=1.0, radius=RADIUS)
    builder.enable_contacts(restitution=restitution)
    return pbd.Scene(builder, frames=60, substeps=4, method=pbd.Jacobi(iterations=20))
