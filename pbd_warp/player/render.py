"""Draws particles without a GPU: balls and links as what a ray from the eye meets of them, in NumPy.

Each is drawn where it can be seen only, with its depth at each pixel, from far to near; at its rim it lets through what
is behind it. That makes edges smooth without drawing anything several times.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pbd_warp.player.drawn import Drawn

FIELD_OF_VIEW = 0.7
MARGIN = 1.12
YAW, PITCH = 0.6, 0.35
"""Vertical [rad], how much more than the motion is seen, and from where a motion in space is: as the page does."""

BACK_TOP, BACK_BOTTOM = np.array([0.12, 0.145, 0.19]), np.array([0.065, 0.078, 0.105])
PARTICLE, FIXED = np.array([0.93, 0.5, 0.28]), np.array([0.84, 0.88, 0.93])
LINK, COLLIDER = np.array([0.4, 0.6, 0.88]), np.array([0.46, 0.52, 0.62])
EDGE = np.array([0.5, 0.57, 0.68])

LEAST = 1.1
"""Pixels of radius that everything has, so that it can be seen."""


@dataclass(frozen=True)
class Eye:
    """A camera. position [m], right, up, forward: [3]; metres: of a pixel at a metre's distance, or, where
    `parallel`, anywhere."""

    position: np.ndarray
    right: np.ndarray
    up: np.ndarray
    forward: np.ndarray
    metres: float
    parallel: bool
    width: int
    height: int

    def project(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pixels [n, 2] from the upper left, and depth along the view [m], [n]."""
        away = x - self.position
        depth = away @ self.forward
        scale = 1.0 / (self.metres * (1.0 if self.parallel else np.maximum(depth, 1e-9)))
        px = 0.5 * self.width + scale * (away @ self.right)
        py = 0.5 * self.height - scale * (away @ self.up)
        return np.stack([px, py], axis=-1), depth

    def pixels(self, radius: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """How large a length [m] is at a depth [m], in pixels."""
        return radius / (self.metres * (1.0 if self.parallel else np.maximum(depth, 1e-9)))


def look_at(low: np.ndarray, high: np.ndarray, axis: int | None, width: int, height: int) -> Eye:
    """Face-on to a motion in a plane across `axis`, from above and aside to any other."""
    yaw, pitch = (YAW, PITCH) if axis is None else [(math.pi / 2, 0.0), (0.0, math.pi / 2), (0.0, 0.0)][axis]
    out = np.array([math.sin(yaw) * math.cos(pitch), math.sin(pitch), math.cos(yaw) * math.cos(pitch)])
    right = np.array([math.cos(yaw), 0.0, -math.sin(yaw)])
    up = np.cross(right, -out)
    centre = 0.5 * (low + high)
    tan = math.tan(0.5 * FIELD_OF_VIEW)
    corners = np.array(np.meshgrid(*zip(low - centre, high - centre, strict=True))).reshape(3, 8).T
    across = np.maximum(np.abs(corners @ right) * height / width, np.abs(corners @ up)) * MARGIN
    parallel = axis is not None
    distance = float(np.max(across / tan + (0.0 if parallel else corners @ out), initial=1e-3))
    metres = 2.0 * tan / height * (distance if parallel else 1.0)
    return Eye(centre + distance * out, right, up, -out, metres, parallel, width, height)


class Renderer:
    """Draws the frames of one motion.

    Args:
        around: What `Drawn.around` gives of it.
        width, height: Of the pictures [px].
    """

    def __init__(self, drawn: Drawn, around: dict, width: int, height: int):
        self._drawn = drawn
        low, high = np.array(around["low"]), np.array(around["high"])
        self.eye = look_at(low, high, around["axis"], width, height)
        tint = np.tile(PARTICLE, (len(drawn.radius), 1))
        tint[drawn.fixed] = FIXED
        self._tint = np.concatenate([tint, np.tile(COLLIDER, (len(drawn.spheres), 1))])
        self._radius = np.concatenate([drawn.radius, drawn.spheres[:, 3]])
        self._polygons = [np.array(polygon) for polygon in around["planes"]]
        self._back = self._background()
        self._back_depth = np.full(self._back.shape[:2], np.inf)
        for solid in drawn.solids:
            if not solid.moves:
                self._facets(self._back, self._back_depth, solid.at(0.0)[solid.triangles])

    def draw(self, x: np.ndarray, time: float = 0.0) -> np.ndarray:
        """A frame as uint8 [height, width, 3], of positions [m], [particle_count, 3], at a time since the start [s]."""
        picture, depth = self._back.copy(), self._back_depth.copy()
        for solid in self._drawn.solids:
            if solid.moves:
                self._facets(picture, depth, solid.at(time)[solid.triangles])
        centres = np.concatenate([x.astype(np.float64), self._drawn.spheres[:, :3]])
        pixel, far = self.eye.project(centres)
        size = np.maximum(self.eye.pixels(self._radius, far), LEAST)
        links = self._drawn.links
        link_far = 0.5 * (far[links[:, 0]] + far[links[:, 1]])
        link_size = np.maximum(self.eye.pixels(self._drawn.link_radius, link_far), 0.7 * LEAST)
        for one in np.argsort(-np.concatenate([far, link_far])):
            if one < len(far):
                if far[one] > 0.0:
                    self._ball(picture, depth, pixel[one], far[one], size[one], self._radius[one], self._tint[one])
            else:
                k = one - len(far)
                i, j = links[k]
                if min(far[i], far[j]) > 0.0:
                    ends = pixel[i], pixel[j], far[i], far[j]
                    self._link(picture, depth, ends, link_size[k], self._drawn.link_radius[k])
        return (255.0 * np.clip(picture, 0.0, 1.0) + 0.5).astype(np.uint8)

    def _ball(
        self, picture: np.ndarray, depth: np.ndarray, at: np.ndarray, far: float, size: float, radius: float,
        tint: np.ndarray,
    ) -> None:  # fmt: skip
        patch = self._patch(at - size - 1.0, at + size + 1.0)
        if patch is None:
            return
        dx, dy = self._offsets(patch, at)
        away = np.hypot(dx, dy)
        nx, ny = dx / size, -dy / size
        nz = np.sqrt(np.maximum(1.0 - nx * nx - ny * ny, 0.0))
        self._blend(picture, depth, patch, size - away + 0.5, far - radius * nz, _lit(tint, nx, ny, nz))

    def _link(
        self, picture: np.ndarray, depth: np.ndarray, ends: tuple[np.ndarray, np.ndarray, float, float], size: float,
        radius: float,
    ) -> None:  # fmt: skip
        a, b, far_a, far_b = ends
        patch = self._patch(np.minimum(a, b) - size - 1.0, np.maximum(a, b) + size + 1.0)
        if patch is None:
            return
        axis = b - a
        length = max(float(np.hypot(*axis)), 1e-6)
        dx, dy = self._offsets(patch, a)
        along = (dx * axis[0] + dy * axis[1]) / length
        across = (dx * axis[1] - dy * axis[0]) / length
        n = np.clip(across / size, -1.0, 1.0)
        nz = np.sqrt(1.0 - n * n)
        cover = np.minimum(size - np.abs(across) + 0.5, np.minimum(along, length - along) + 0.5)
        far = far_a + (far_b - far_a) * np.clip(along / length, 0.0, 1.0) - radius * nz
        tint = _lit(LINK, n * axis[1] / length, n * axis[0] / length, nz)
        self._blend(picture, depth, patch, cover, far, tint)

    def _facets(self, picture: np.ndarray, depth: np.ndarray, corners: np.ndarray) -> None:
        """Triangles [m], [n, 3, 3]."""
        eye = self.eye
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
        seen = np.stack([normal @ eye.right, normal @ eye.up, -normal @ eye.forward], axis=1)
        seen *= np.where(seen[:, 2:] < 0.0, -1.0, 1.0)
        tints = _lit(COLLIDER, *seen.T)
        pixel, far = eye.project(corners.reshape(-1, 3))
        for tint, at, deep in zip(tints, pixel.reshape(-1, 3, 2), far.reshape(-1, 3), strict=True):
            patch = self._patch(at.min(axis=0) - 1.0, at.max(axis=0) + 1.0)
            (ax, ay), (bx, by), (cx, cy) = at
            area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
            if patch is None or deep.min() <= 0.0 or abs(area) < 1e-9:
                continue
            dx, dy = self._offsets(patch, at[0])
            b = (dx * (cy - ay) - dy * (cx - ax)) / area
            c = (dy * (bx - ax) - dx * (by - ay)) / area
            inside = np.minimum(np.minimum(b, c), 1.0 - b - c) >= -1e-9
            depths = deep[0] + b * (deep[1] - deep[0]) + c * (deep[2] - deep[0])
            self._blend(picture, depth, patch, inside.astype(float), depths, tint)

    def _patch(self, low: np.ndarray, high: np.ndarray) -> tuple[slice, slice] | None:
        """Rows and columns of the picture between two corners [px], None where there are none."""
        limit = self.eye.width, self.eye.height
        (x0, y0), (x1, y1) = (np.clip(np.rint(corner), 0, limit).astype(int) for corner in (low, high))
        return (slice(y0, y1), slice(x0, x1)) if x1 > x0 and y1 > y0 else None

    @staticmethod
    def _offsets(patch: tuple[slice, slice], at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the middle of each pixel from a place [px], as a row and a column."""
        rows, columns = patch
        dx = np.arange(columns.start, columns.stop)[None, :] + 0.5 - at[0]
        dy = np.arange(rows.start, rows.stop)[:, None] + 0.5 - at[1]
        return dx, dy

    @staticmethod
    def _blend(
        picture: np.ndarray, depth: np.ndarray, patch: tuple[slice, slice], cover: np.ndarray, far: np.ndarray,
        tint: np.ndarray,
    ) -> None:  # fmt: skip
        part = np.clip(cover, 0.0, 1.0) * (far < depth[patch])
        picture[patch] += part[..., None] * (tint - picture[patch])
        depth[patch] = np.where(part > 0.5, far, depth[patch])

    def _background(self) -> np.ndarray:
        """A sky, and the outlines of planes."""
        height, width = self.eye.height, self.eye.width
        down = np.linspace(0.0, 1.0, height)[:, None, None]
        picture = np.broadcast_to((1.0 - down) * BACK_TOP + down * BACK_BOTTOM, (height, width, 3)).copy()
        nowhere = np.full((height, width), np.inf)
        for polygon in self._polygons:
            pixel, far = self.eye.project(polygon)
            for k in range(len(pixel)):
                if min(far[k], far[k - 1]) > 0.0:
                    self._line(picture, nowhere, pixel[k - 1], pixel[k])
        return picture

    def _line(self, picture: np.ndarray, depth: np.ndarray, a: np.ndarray, b: np.ndarray) -> None:
        patch = self._patch(np.minimum(a, b) - 2.0, np.maximum(a, b) + 2.0)
        axis = b - a
        length = float(np.hypot(*axis))
        if patch is None or length == 0.0:
            return
        dx, dy = self._offsets(patch, a)
        across = np.abs(dx * axis[1] - dy * axis[0]) / length
        along = (dx * axis[0] + dy * axis[1]) / length
        cover = np.minimum(1.2 - across, np.minimum(along, length - along) + 0.5)
        self._blend(picture, depth, patch, 0.8 * np.clip(cover, 0.0, 1.0), np.zeros_like(across), EDGE)


def _lit(tint: np.ndarray, nx: np.ndarray, ny: np.ndarray, nz: np.ndarray) -> np.ndarray:
    """A colour under a light from the upper left behind the eye, of normals seen from there."""
    light = np.array([-0.45, 0.7, 0.55])
    light /= np.linalg.norm(light)
    key = np.maximum(nx * light[0] + ny * light[1] + nz * light[2], 0.0)
    bright = 0.26 + 0.24 * (0.5 + 0.5 * ny) + 0.64 * key
    return bright[..., None] * tint + 0.14 * (key**24)[..., None]
