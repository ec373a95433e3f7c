"""Ropes that somebody has drawn: points in space, some of them pinned."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pbd_warp import check
from pbd_warp.errors import InputError
from pbd_warp.scene import Scene

LINKS = 30
"""Of a drawn rope, about."""

MOST_POINTS = 100
MASS = 1.0  # kg, of a rope
RADIUS = 0.2  # of a link's length


@dataclass(frozen=True)
class DrawnRope:
    """Straight from point to point [m]; pinned: which of the points are fixed.

    Raises:
        InputError: fewer than two points, more than 100, two in a row at one place, a pin that is no point.
    """

    points: tuple[tuple[float, float, float], ...]
    pinned: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        x = check.vectors("rope: points", self.points)
        if not 2 <= len(x) <= MOST_POINTS:
            raise InputError(f"a drawn rope has 2 to {MOST_POINTS} points, not {len(x)}")
        lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
        if lengths.min() < 1e-3 * lengths.sum():
            where = int(np.argmin(lengths))
            raise InputError(f"points {where} and {where + 1} of the rope are at one place: leave one out")
        for pin in self.pinned:
            if isinstance(pin, bool) or not isinstance(pin, int) or not 0 <= pin < len(x):
                raise InputError(f"rope: pinned names point {pin} of {len(x)}")
        object.__setattr__(self, "points", tuple(map(tuple, x.tolist())))
        object.__setattr__(self, "pinned", tuple(self.pinned))

    def particles(self) -> tuple[np.ndarray, list[int]]:
        """Positions [m], [n, 3]: every point is one, with links of about the same length between them; and which are
        pinned."""
        x = np.array(self.points)
        lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
        pieces = np.maximum(1, np.round(LINKS * lengths / lengths.sum())).astype(int)
        straight = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(x, x[1:], pieces, strict=False)]
        number = np.append(0, np.cumsum(pieces))
        return np.concatenate([*straight, x[-1:]]), [int(number[pin]) for pin in self.pinned]

    def to_json(self) -> dict[str, Any]:
        return {"points": [list(point) for point in self.points], "pinned": list(self.pinned)}

    @classmethod
    def from_json(cls, data: Any) -> DrawnRope:
        """Raises an InputError for what `to_json` would not have written."""
        if not isinstance(data, dict) or sorted(data) != ["pinned", "points"]:
            raise InputError("a drawn rope must have points and pinned")
        if not isinstance(data["points"], list) or not isinstance(data["pinned"], list):
            raise InputError("points and pinned of a drawn rope must be lists")
        return cls(tuple(data["points"]), tuple(data["pinned"]))


def with_ropes(scene: Scene, ropes: Sequence[DrawnRope]) -> Scene:
    """The scene with ropes that were drawn into it."""
    if not ropes:
        return scene
    builder = copy.deepcopy(scene.builder)
    for rope in ropes:
        x, pinned = rope.particles()
        link = float(np.linalg.norm(np.diff(x, axis=0), axis=1).min())
        builder.add_rope(x, mass=MASS, pinned=pinned, radius=RADIUS * link)
    return scene.changed(builder=builder, reference=None)
