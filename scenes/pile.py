"""A rope that falls onto the ground in coils and comes to rest on itself.

One should see coil land on coil, the heap settle, and no strand pass through another.
"""

import numpy as np

import pbd_warp as pbd

LINK, THICK = 0.02, 0.009  # m: length of a link, the rope's radius
COIL, PITCH = 0.05, 0.03  # m: radius of the coils in which it falls, from one to the next


def scene(links: int = 80, friction: float = 0.5) -> pbd.Scene:
    turn = LINK / np.hypot(COIL, PITCH / (2.0 * np.pi))
    angle = turn * np.arange(links + 1)
    x = np.stack([COIL * np.cos(angle), 0.03 + PITCH * angle / (2.0 * np.pi), COIL * np.sin(angle)], axis=1)
    builder = pbd.ModelBuilder()
    builder.add_rope(x, mass=0.005 * (links + 1), pinned=(), radius=THICK)
    builder.add_plane((0, 0, 0), (0, 1, 0), friction=friction)
    builder.enable_contacts(friction=friction, links=True)
    return pbd.Scene(builder, frames=240, substeps=16, method=pbd.GaussSeidel(8), damping=0.1)
