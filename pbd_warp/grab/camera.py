"""A perspective camera: from the world to the pixels of a screen and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pbd_warp import check
from pbd_warp.errors import InputError

FARTHEST = 1e6
"""An eye beyond this [m] is a mistake: what it leads would be lost to rounding."""

LARGEST_SCREEN = 32768.0
"""Pixels, in each direction."""

TIE = 1e-3
"""Distances on the screen that differ by less than this [px] are the same."""


class Camera:
    """What a screen shows.

    Args:
        eye: Where it looks from [m].
        forward, up: Directions, of any length; up need not be square to forward.
        field_of_view: From the lower edge of the screen to the upper one [rad].
        size: Width and height of the screen [px]. A place on it is (x, y) from its upper left corner.

    Raises:
        InputError: what is not finite, directions without a length or along each other, an eye beyond 1000 km, a field
            of view outside (0, pi), a screen without area.
    """

    def __init__(self, eye: ArrayLike, forward: ArrayLike, up: ArrayLike, field_of_view: float, size: ArrayLike):
        self.eye = _bounded("camera: eye", check.vector("camera: eye", eye), FARTHEST)
        self.forward = _unit("camera: forward", check.vector("camera: forward", forward))
        right = np.cross(self.forward, _unit("camera: up", check.vector("camera: up", up)))
        if np.linalg.norm(right) < 1e-6:
            raise InputError("camera: up must not point along forward")
        self.right = _unit("camera: right", right)
        self.up = np.cross(self.right, self.forward)
        angle = check.number("camera: field_of_view", field_of_view, low=1e-3)
        if angle >= 3.1:
            raise InputError(f"camera: field_of_view must be in (0, 3.1), not {angle:g}")
        self.size = _pair("camera: size", size, LARGEST_SCREEN)
        if not np.all(self.size >= 1.0):
            raise InputError("camera: size must be at least one pixel each way")
        self.scale = 0.5 * self.size[1] / np.tan(0.5 * angle)
        """Pixels of a metre at a depth of one metre."""

    def depth(self, x: np.ndarray) -> np.ndarray:
        """Distance from the eye along `forward` [m]; not positive behind the camera. x: [..., 3]."""
        return (x - self.eye) @ self.forward

    def project(self, x: np.ndarray) -> np.ndarray:
        """Places on the screen [px], shape [n, 2]; NaN where a point [n, 3] is not in front of the camera."""
        depth = self.depth(x)
        scale = np.divide(self.scale, depth, out=np.full(len(x), np.nan), where=depth > 0.0)
        away = x - self.eye
        return 0.5 * self.size + scale[:, None] * np.stack([away @ self.right, -(away @ self.up)], axis=1)

    def pick(self, x: np.ndarray, radius: np.ndarray, at: ArrayLike, reach: float) -> int | None:
        """The particle nearest to a place on the screen, None where none is within `reach` [px].

        The distance is to the disc that shows the particle, so 0 on it. Of several at the same distance the front-most
        is taken: on discs, the one whose surface is in front there.

        Args:
            x: Positions [m], shape [n, 3].
            radius: As drawn [m], shape [n].
            at: Place on the screen [px], [2].
        """
        at = self.place(at)
        depth = self.depth(x)
        seen = depth > 0.0
        metres = np.divide(depth, self.scale, out=np.full(len(x), np.nan), where=seen)  # of a pixel at that depth
        away = np.linalg.norm(self.project(x) - at, axis=1)
        gap = np.maximum(away - radius / metres, 0.0)
        front = depth - np.sqrt(np.maximum(radius**2 - (away * metres) ** 2, 0.0))
        near = np.flatnonzero(seen & (gap <= reach))  # NaN is not
        if not near.size:
            return None
        order = np.lexsort((front[near], np.round(gap[near] / TIE)))
        return int(near[order[0]])

    def on_facing_plane(self, at: ArrayLike, through: np.ndarray) -> np.ndarray:
        """The point shown at a place on the screen that lies in the camera-facing plane through a point [m].

        Raises:
            InputError: the plane is not in front of the camera.
        """
        x, y = (self.place(at) - 0.5 * self.size) / self.scale
        depth = self.depth(np.asarray(through))
        if not depth > 0.0:
            raise InputError("camera: the held particle is behind it")
        return self.eye + depth * (self.forward + x * self.right - y * self.up)

    def place(self, at: ArrayLike) -> np.ndarray:
        """A place on the screen or near it [px], [2]."""
        return _pair("at", at, 2.0 * LARGEST_SCREEN)


def _pair(name: str, value: Any, limit: float) -> np.ndarray:
    """Two finite numbers, checked like vectors."""
    if np.shape(value) != (2,):
        raise InputError(f"{name} must be two numbers")
    return _bounded(name, check.vector(name, [*value, 0.0])[:2], limit)


def _bounded(name: str, value: np.ndarray, limit: float) -> np.ndarray:
    if np.any(np.abs(value) > limit):
        raise InputError(f"{name} must be within {limit:g} of 0")
    return value


def _unit(name: str, vector: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    if not 1e-12 < length < 1e12:
        raise InputError(f"{name} must have a direction")
    return vector / length
