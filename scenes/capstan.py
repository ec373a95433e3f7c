"""A rope over a ball, held by friction against a heavier load: the capstan equation.

One should see nothing move while the load is below what friction holds, e^(mu pi) times the other, and the rope slide
over the ball above it. Sweeps let it creep at any load.
"""

import numpy as np

import pbd_warp as pbd

BALL, SIDE = 0.3, 0.6  # m: of the circle that the rope's middle lies on, and what hangs down on either side
THICK = 0.005  # m: the rope's radius
ROPE, WEIGHT = 0.01, 1.0  # kg: of the rope, and at its lighter end


def scene(load: float = 0.9, friction: float = 0.3, links: int = 60) -> pbd.Scene:
    """load: At the heavier end, over what the polygon of the rope's links holds."""
    x = path(links)
    mass = np.full(links + 1, ROPE / (links + 1))
    mass[0] += WEIGHT
    mass[-1] += WEIGHT * load * limit(x, friction)
    builder = pbd.ModelBuilder()
    builder.add_rope(x, mass=mass, pinned=(), radius=THICK)
    builder.add_sphere((0, 0, 0), BALL - THICK, friction=friction)
    return pbd.Scene(builder, frames=120, substeps=4, method=pbd.Direct())


def path(links: int) -> np.ndarray:
    """Straight up, half around the ball, straight down; shape [links + 1, 3]."""
    along = np.linspace(0.0, np.pi * BALL + 2.0 * SIDE, links + 1)
    angle = np.clip(along - SIDE, 0.0, np.pi * BALL) / BALL
    down = np.maximum(SIDE - along, 0.0) + np.maximum(along - SIDE - np.pi * BALL, 0.0)
    return np.stack([-BALL * np.cos(angle), BALL * np.sin(angle) - down, 0.0 * along], axis=1)


def limit(x: np.ndarray, friction: float) -> float:
    """The ratio of tensions at which a rope of these points slides: the product over those that touch of
    (1 + mu tan(turn/2)) / (1 - mu tan(turn/2))."""
    d = np.diff(x, axis=0)
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    turn = np.arccos(np.clip(np.sum(d[1:] * d[:-1], axis=1), -1.0, 1.0))
    grip = friction * np.tan(turn[np.abs(np.linalg.norm(x[1:-1], axis=1) - BALL) < 1e-9] / 2.0)
    return float(np.prod((1.0 + grip) / (1.0 - grip)))
