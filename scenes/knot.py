"""A knot in a rope, pulled tight by a load: an overhand knot, or a square knot that joins two ropes.

One should see the overhand knot draw together and hold whatever the load, no strand passing through another. The square
knot holds with friction of 0.25; with 0.1 it slips until the ropes have come apart (`--set square=true,friction=0.1`).
"""

import numpy as np

import pbd_warp as pbd

LINK, THICK = 0.02, 0.009  # m: length of a link, the rope's radius
MASS = 0.005  # kg: of a particle

TREFOIL = 0.036  # m: of the overhand knot's curve, (sin t + 2 sin 2t, cos t - 2 cos 2t, -sin 3t) without its last arc
SQUARE = 0.02  # m: of the square knot's
HALF = np.array(
    [
        *((-30, 1, 0), (-20, 1, 0), (-8, 1, 0.2), (-5, 1, 0.48), (-3, 1, 0.8), (-1.5, 1.25, 0), (0, 1.8, -0.8)),
        *((1.5, 2.5, -0.3), (2.6, 2.1, 0.48), (3.1, 1, 0.8)),
    ]
)
"""The square knot's rope that comes from the left, up to where it turns back: the way back is its image below y = 0,
the other rope is the same, turned half around about y."""


def scene(square: bool = False, friction: float = 0.3, load: float = 0.2) -> pbd.Scene:
    """square: Two ropes in a square knot. friction: Of rope on rope. load: At the lower end [kg]."""
    builder = pbd.ModelBuilder()
    if square:
        one = square_half(60)
        hang(builder, one, {0: None})
        hang(builder, one * (-1, 1, -1), {0: load})
    else:
        hang(builder, overhand(100), {0: None, 100: load})
    builder.enable_contacts(friction=friction, links=True)
    return pbd.Scene(
        builder, frames=240, substeps=4, damping=0.15, method=pbd.Direct(60, tolerance=1e-5), on_failure="subdivide"
    )


def hang(builder: pbd.ModelBuilder, x: np.ndarray, ends: dict[int, float | None]) -> None:
    """A rope, its x axis pointing down; ends: what is fixed (None) or carries a load."""
    mass = np.full(len(x), MASS)
    for end, load in ends.items():
        mass[end] = 0.0 if load is None else MASS + load
    rope = builder.add_particles(x[:, [1, 0, 2]] * (1, -1, 1), mass=mass, radius=THICK)
    builder.add_distances(np.stack([rope[:-1], rope[1:]], axis=1))


def overhand(links: int) -> np.ndarray:
    t = np.linspace(np.pi + 0.5, 3 * np.pi - 0.5, 25)
    knot = np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1)
    tail = np.array([(1.9, -2.9, 0), (3.2, -3.3, 0), (6, -3.3, 0), (20, -3.3, 0)])
    x = points(TREFOIL * np.concatenate([tail[::-1], knot, tail * (-1, 1, 1)]), links)
    return x[::-1]


def square_half(links: int) -> np.ndarray:
    return points(SQUARE * np.concatenate([HALF, [(3.2, 0, 0.8)], HALF[::-1] * (1, -1, 1)]), links)


def points(curve: np.ndarray, links: int) -> np.ndarray:
    """Points a link apart from each other along the middle part of a smooth curve through these, [links + 1, 3]."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    slope = np.gradient(curve, along, axis=0)
    place = np.linspace(0.0, along[-1], 20000)
    k = np.clip(np.searchsorted(along, place, side="right") - 1, 0, len(along) - 2)
    span = (along[k + 1] - along[k])[:, None]
    t = (place - along[k])[:, None] / span
    # Hermite's cubic between two points and the slopes there.
    fine = (2 * t**3 - 3 * t**2 + 1) * curve[k] + (3 * t**2 - 2 * t**3) * curve[k + 1]
    fine += span * ((t**3 - 2 * t**2 + t) * slope[k] + (t**3 - t**2) * slope[k + 1])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    at = int(np.searchsorted(length, (length[-1] - links * LINK) / 2.0))
    found = [fine[at]]
    while len(found) <= links:
        far = np.linalg.norm(fine[at:] - found[-1], axis=1)
        beyond = int(np.argmax(far > LINK))
        before, after = fine[at + beyond - 1], fine[at + beyond]
        way, off = after - before, before - found[-1]
        a, b, c = way @ way, off @ way, off @ off - LINK**2
        found.append(before + (np.sqrt(b * b - a * c) - b) / a * way)
        at += beyond - 1
    return np.array(found)
