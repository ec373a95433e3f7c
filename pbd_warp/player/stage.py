"""Reads the motion of a USD stage: its points and curves, spheres and planes."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import numpy as np
from pxr import Tf, Usd, UsdGeom

from pbd_warp.drawing.surroundings import ROPE_WIDTH
from pbd_warp.errors import InputError
from pbd_warp.player.drawn import Drawn
from pbd_warp.player.motion import Motion

PIECES = 4
"""Straight pieces that a span of a cubic curve is drawn with."""

BASES = {
    "bspline": np.array([[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 6.0,
    "catmullRom": np.array([[0, 2, 0, 0], [-1, 0, 1, 0], [2, -5, 4, -1], [-1, 3, -3, 1]]) / 2.0,
    "bezier": np.array([[1, 0, 0, 0], [-3, 3, 0, 0], [3, -6, 3, 0], [-1, 3, -3, 1]]) / 1.0,
}
"""Of each basis: row k has the weights of four control points in front of t^k (UsdGeomBasisCurves)."""

SHOWN = ("Points", "BasisCurves", "Sphere", "Plane")
QUIET = ("", "Xform", "Scope", "Camera", "Material", "Shader", "GeomSubset", "PhysicsScene")
JOINT = 0.9
"""Balls between the pieces of a curve, relative to its width: they fill its bends, and hide none of its colour."""

MOST_FRAMES = 100_000


def read_motion(path: str | os.PathLike[str]) -> tuple[Motion, dict[str, int]]:
    """The motion in a .usda, .usdc, .usd or .usdz file, and how many prims of which type are not shown.

    A frame is a time code. Points are balls; curves are links between balls of their width, cubic ones straight
    between points on them; stretch is measured against the first frame, as USD has no rest lengths. Metres and y up,
    whatever the stage has. Planes are shown as without end.

    Raises:
        InputError: no such file, one that is no stage, or a stage without points and curves.
    """
    if not Path(path).is_file():
        raise InputError(f"there is no file {path}")
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"{path} is no USD stage: {str(error).strip().splitlines()[-1]}") from None
    prims = [prim for prim in stage.Traverse() if UsdGeom.Imageable(prim) and _visible(prim)]
    clouds = [UsdGeom.Points(prim) for prim in prims if prim.IsA(UsdGeom.Points)]
    curves = [UsdGeom.BasisCurves(prim) for prim in prims if prim.IsA(UsdGeom.BasisCurves)]
    if not clouds and not curves:
        raise InputError(f"{path} has neither points nor curves: nothing in it can be played")
    times = _times(stage)
    strands = [_Strand(geometry, 1.0 if not clouds else ROPE_WIDTH) for geometry in curves]
    world = _World(stage)
    frames = []
    for time in times:
        parts = [world.place(cloud, _array(cloud.GetPointsAttr(), time), time) for cloud in clouds]
        parts += [world.place(strand.geometry, strand.points(time), time) for strand in strands]
        frames.append(np.concatenate(parts))
    if len({len(frame) for frame in frames}) > 1:
        raise InputError(f"{path} has another number of points in one frame than in another: it cannot be played")
    first = times[0]
    radius = [0.5 * world.metres * _widths(cloud, cloud.GetPointsAttr(), first) for cloud in clouds]
    start = sum(map(len, radius))
    links, link_radius = [np.zeros((0, 2), int)], [np.zeros(0)]
    for strand in strands:
        thick = 0.5 * world.metres * strand.width(first)
        links.append(start + strand.links)
        link_radius.append(thick[strand.links].min(axis=1, initial=np.inf))
        radius.append(JOINT * thick)
        start += len(thick)
    edge = np.concatenate(links)
    x = np.array(frames)
    planes, spheres = world.colliders(prims, first)
    drawn = Drawn(
        radius=np.concatenate(radius),
        fixed=np.zeros(0, int),
        links=edge,
        link_radius=np.concatenate(link_radius),
        rest_length=np.linalg.norm(x[0, edge[:, 0]] - x[0, edge[:, 1]], axis=1),
        plane_point=planes[:, 0],
        plane_normal=planes[:, 1],
        spheres=spheres,
    )
    types = Counter(str(prim.GetTypeName()) for prim in prims)
    hidden = {name: n for name, n in types.items() if name not in (*SHOWN, *QUIET) and "Light" not in name}
    fps = stage.GetTimeCodesPerSecond()
    return Motion(drawn, x.astype(np.float32), fps, Path(path).name, "the first frame"), hidden


def _visible(prim: Usd.Prim) -> bool:
    purpose = UsdGeom.Imageable(prim).ComputePurpose()
    return purpose in ("default", "render") and UsdGeom.Imageable(prim).ComputeVisibility() != "invisible"


def _times(stage: Usd.Stage) -> list[float]:
    """The time codes to show: those of the stage's range, one apart."""
    if not stage.HasAuthoredTimeCodeRange():
        return [0.0]
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if not 0 <= last - first < MOST_FRAMES:
        raise InputError(f"the stage's range is {first:g} to {last:g}: more than {MOST_FRAMES} frames, or none")
    return [float(time) for time in np.arange(first, last + 1e-6)]


def _array(attribute: Usd.Attribute, time: float) -> np.ndarray:
    value = attribute.Get(time)
    return np.zeros((0, 3)) if value is None else np.asarray(value, dtype=np.float64)


def _widths(geometry: UsdGeom.Points | UsdGeom.BasisCurves, points: Usd.Attribute, time: float) -> np.ndarray:
    """A diameter for each point, in the stage's unit."""
    count = len(_array(points, time))
    width = np.asarray(geometry.GetWidthsAttr().Get(time) or [], dtype=np.float64)
    if len(width) == count:
        return width
    extent = np.ptp(_array(points, time), axis=0).max() if count else 1.0
    return np.full(count, width.mean() if len(width) else 0.01 * (extent or 1.0))


class _Strand:
    """A BasisCurves as straight pieces.

    links: Pairs of its points [link_count, 2].
    """

    def __init__(self, geometry: UsdGeom.BasisCurves, thinner: float):
        self.geometry = geometry
        self._thinner = thinner
        counts = np.asarray(geometry.GetCurveVertexCountsAttr().Get() or [], dtype=int)
        closed = geometry.GetWrapAttr().Get() == "periodic"
        basis = geometry.GetBasisAttr().Get() if geometry.GetTypeAttr().Get() == "cubic" else None
        blocks, links, rows, columns = [], [], 0, int(counts.sum())
        start = 0
        for n in counts:
            weights = _weights(int(n), basis, closed)
            block = np.zeros((len(weights), columns))
            block[:, start : start + n] = weights
            blocks.append(block)
            line = rows + np.arange(len(weights))
            links.append(np.stack([line[:-1], line[1:]], axis=1))
            if closed and len(line) > 2:
                links.append(np.array([[line[-1], line[0]]]))
            start, rows = start + n, rows + len(weights)
        self._blocks = blocks
        self.links = np.concatenate([np.zeros((0, 2), int), *links])

    def points(self, time: float) -> np.ndarray:
        """On the curves, [n, 3]."""
        return self._apply(_array(self.geometry.GetPointsAttr(), time))

    def width(self, time: float) -> np.ndarray:
        """Diameters at those, [n]."""
        each = _widths(self.geometry, self.geometry.GetPointsAttr(), time)
        return self._thinner * self._apply(each[:, None])[:, 0]

    def _apply(self, values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros((0, values.shape[1])), *(block @ values for block in self._blocks)])


def _weights(n: int, basis: str | None, closed: bool) -> np.ndarray:
    """How points on a curve come from its n control points: [points, n]; the last of a closed one is not the first."""
    if basis not in BASES or n < 4:
        return np.eye(n)
    step = 3 if basis == "bezier" else 1
    spans = n // step if closed else (n - 4) // step + 1
    t = np.arange(PIECES) / PIECES
    powers = np.stack([t**0, t, t**2, t**3], axis=1) @ BASES[basis]
    rows = np.zeros((spans * PIECES, n))
    for span in range(spans):
        for k in range(4):
            rows[span * PIECES : (span + 1) * PIECES, (span * step + k) % n] += powers[:, k]
    if closed:
        return rows
    end = np.zeros((1, n))
    end[0, (spans - 1) * step : (spans - 1) * step + 4] = BASES[basis].sum(axis=0)  # at t = 1
    return np.concatenate([rows, end])


class _World:
    """From the spaces of a stage's prims to metres with y up."""

    def __init__(self, stage: Usd.Stage):
        self.metres = UsdGeom.GetStageMetersPerUnit(stage)
        self._z_up = UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z

    def place(self, geometry: UsdGeom.Gprim, points: np.ndarray, time: float) -> np.ndarray:
        matrix = np.array(geometry.ComputeLocalToWorldTransform(time))  # row vectors
        return self._upright(self.metres * (points @ matrix[:3, :3] + matrix[3, :3]))

    def colliders(self, prims: list[Usd.Prim], time: float) -> tuple[np.ndarray, np.ndarray]:
        """Planes [n, 2, 3], a point and a normal each, and spheres [m, 4]."""
        planes, spheres = [np.zeros((0, 2, 3))], [np.zeros((0, 4))]
        for prim in prims:
            if prim.IsA(UsdGeom.Sphere):
                ball = UsdGeom.Sphere(prim)
                reach = np.array([[0.0, 0, 0], [ball.GetRadiusAttr().Get(time), 0, 0]])
                centre, rim = self.place(ball, reach, time)
                spheres.append(np.array([[*centre, np.linalg.norm(rim - centre)]]))
            elif prim.IsA(UsdGeom.Plane):
                plane = UsdGeom.Plane(prim)
                normal = np.eye(3)["XYZ".index(plane.GetAxisAttr().Get())]
                foot, tip = self.place(plane, np.array([0.0 * normal, normal]), time)
                planes.append(np.array([[foot, (tip - foot) / np.linalg.norm(tip - foot)]]))
        return np.concatenate(planes), np.concatenate(spheres)

    def _upright(self, x: np.ndarray) -> np.ndarray:
        return np.stack([x[:, 0], x[:, 2], -x[:, 1]], axis=1) if self._z_up else x
