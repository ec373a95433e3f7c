"""Writes a simulation's frames as a USD animation."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from pxr import Gf, Kind, Usd, UsdGeom, Vt

from pbd_warp import check
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.identity import Identity
from pbd_warp.model.model import Model, State
from pbd_warp.paths import check_file
from pbd_warp.usd.animation import Animation
from pbd_warp.usd.space import Space
from pbd_warp.usd.surroundings import Surroundings
from pbd_warp.usd.tension import AlongChains, define_tension

EXTENSIONS = (".usda", ".usdc", ".usd")

PARTICLE_COLOUR = (0.85, 0.45, 0.2)
FIXED_COLOUR = (0.15, 0.15, 0.2)
ROPE_COLOUR = (0.25, 0.45, 0.75)

SHOWN_WIDTH = 0.3
"""Particles without a radius are drawn this wide, relative to the median link."""


def check_path(path: str | os.PathLike[str]) -> Path:
    """The file that a stage can be written to there, through links, or an InputError that says why there is none."""
    out = Path(path)
    if out.suffix not in EXTENSIONS:
        raise InputError(f"{out} must end in one of {', '.join(EXTENSIONS)}, not in {out.suffix or 'nothing'!r}")
    return check_file(out, added=".partial.frames")


class UsdWriter:
    """Writes frames to a .usda, .usdc or .usd file; use it as a context manager.

    Time code n is the n-th frame written, an integer. The file appears under its name when it is complete, whole
    or not at all. After an exception (Ctrl-C included) the frames so far become a valid file too: under the
    name asked for, or, where an older file stands there, beside it as `<stem>.partial<extension>`; an unfinished
    file never replaces a finished one. What a killed process leaves has that name too (see
    `pbd_warp.usd.animation.Animation`).

    Args:
        path: Where to. Its folder exists.
        model: What the states belong to.
        fps: Frames, and time codes, a second.
        metadata: Provenance, kept as customLayerData: names to strings or numbers.
        resume: Go on after so many frames of what lies on disk; frames beyond are dropped.
        up_axis: "Y", as models have it, or "Z": everything is turned with it.
        meters_per_unit: Of the numbers in the file; models are in metres.
        identity: Of the run; only files that carry the same are gone on from.
        tension: Write `primvars:tension` of the curves [N], at each point the mean of the links that meet there.

    Attributes:
        tension: Whether tensions are written.
        frames: Frames written so far.
        saved: The path written in the end, None until then.

    Raises:
        InputError: an unknown extension, a folder that does not exist or cannot be written to, fps <= 0, fewer frames
            on disk than `resume`, another process that is writing to the path, an axis or a unit that is none,
            tensions of a model without distances.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        model: Model,
        fps: float = 60.0,
        metadata: Mapping[str, str | int | float] | None = None,
        resume: int | None = None,
        up_axis: str = "Y",
        meters_per_unit: float = 1.0,
        identity: Identity | None = None,
        tension: bool = False,
    ):
        self._path = check_path(path)
        self._model = model
        self.tension = tension
        if tension and not len(model.distance):
            raise InputError("there are no distances, so there is no tension to write")
        self._space = space = Space(up_axis, meters_per_unit)

        self._stage = stage = Usd.Stage.CreateInMemory()
        fps = check.number("fps", fps, above=0.0)
        UsdGeom.SetStageUpAxis(stage, space.up_axis)
        UsdGeom.SetStageMetersPerUnit(stage, space.meters_per_unit)
        stage.SetTimeCodesPerSecond(fps)
        stage.SetFramesPerSecond(fps)
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(0)
        if metadata:
            stage.GetRootLayer().customLayerData = dict(metadata)
        world = UsdGeom.Xform.Define(stage, "/World")
        Usd.ModelAPI(world).SetKind(Kind.Tokens.component)
        stage.SetDefaultPrim(world.GetPrim())

        width = space.length(shown_widths(model))
        self._geometry = [self._define_points(width)]
        loose = loose_edges(model)
        if model.ropes:
            self._geometry.append(self._define_curves("Ropes", list(model.ropes), width))
        if np.any(loose):
            self._geometry.append(self._define_curves("Edges", list(model.distance.edge[loose]), 0.5 * width))

        attributes = [attribute for geometry in self._geometry for attribute in geometry.attributes]
        self._surroundings = Surroundings(stage, model.colliders, space, fps)
        self._animation = Animation(self._path, stage, attributes, resume, self._surroundings.define, identity)
        for extent in self._animation.values(self._geometry[0].extent):
            self._surroundings.include(extent)

    @property
    def frames(self) -> int:
        return self._animation.frames

    @property
    def saved(self) -> Path | None:
        return self._animation.saved

    def write(self, state: State, tension: np.ndarray | None = None) -> None:
        """Write one frame.

        Args:
            tension: Of its distances, `Simulation.tension`; only where tensions are written, and there always.

        Raises:
            SimulationFailed: a position or velocity is not finite (extents would silently leave it out).
        """
        if self.tension != (tension is not None):
            raise InputError(f"tensions are {'' if self.tension else 'not '}to be written (UsdWriter(tension=))")
        x, v = (np.ascontiguousarray(self._space(a.numpy()), dtype=np.float32) for a in (state.x, state.v))
        if not (np.isfinite(x).all() and np.isfinite(v).all()):
            raise SimulationFailed(f"frame {self.frames} is not finite and was not written to {self._path}")
        everything = _usd_vectors(x), _usd_vectors(v)
        values = [value for geometry in self._geometry for value in geometry.values(x, v, everything, tension)]
        self._surroundings.include(values[2])  # the extent of all particles
        self._animation.write(values, self.frames)

    def flush(self) -> None:
        """Make the frames so far survive a kill; otherwise every 32 frames do.

        Raises:
            SimulationFailed: they could not be written.
        """
        self._animation.flush()

    def close(self) -> None:
        """Complete the file and put it under its name.

        Raises:
            SimulationFailed: it could not be written; the error says where the frames so far are.
        """
        self._animation.close()

    def __enter__(self) -> UsdWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._animation.__exit__(kind, error, trace)

    def _define_points(self, width: np.ndarray) -> _Geometry:
        points = UsdGeom.Points.Define(self._stage, "/World/Particles")
        n = self._model.particle_count
        points.CreateIdsAttr(Vt.Int64Array.FromNumpy(np.arange(n)))
        colour = np.where(self._model.w[:, None] > 0.0, PARTICLE_COLOUR, FIXED_COLOUR).astype(np.float32)
        points.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex).Set(Vt.Vec3fArray.FromNumpy(colour))
        points.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
        return _Geometry(points, np.arange(n), width, n)

    def _define_curves(self, name: str, chains: list[np.ndarray], width: np.ndarray) -> _Geometry:
        curves = UsdGeom.BasisCurves.Define(self._stage, f"/World/{name}")
        curves.CreateTypeAttr(UsdGeom.Tokens.linear)
        curves.CreateWrapAttr(UsdGeom.Tokens.nonperiodic)
        curves.CreateCurveVertexCountsAttr(Vt.IntArray([len(chain) for chain in chains]))
        curves.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([Gf.Vec3f(*ROPE_COLOUR)])
        curves.SetWidthsInterpolation(UsdGeom.Tokens.vertex)
        index = np.concatenate(chains)
        along = AlongChains(self._model, chains) if self.tension else None
        return _Geometry(curves, index, width[index], self._model.particle_count, along)


class _Geometry:
    """A UsdGeom.Points or BasisCurves whose points are the particles of `index`; along: gives their tensions."""

    def __init__(
        self,
        geometry: UsdGeom.Points | UsdGeom.BasisCurves,
        index: np.ndarray,
        width: np.ndarray,
        particles: int,
        along: AlongChains | None = None,
    ):
        self._geometry = geometry
        self._index = index
        self._has_all = np.array_equal(index, np.arange(particles))  # in order: nothing to pick or to convert again
        self._widths = Vt.FloatArray.FromNumpy(width.astype(np.float32))
        geometry.CreateWidthsAttr(self._widths)
        self.extent = geometry.CreateExtentAttr()
        self._along = along
        own = (define_tension(geometry.GetPrim()),) if along else ()
        self.attributes = (geometry.CreatePointsAttr(), geometry.CreateVelocitiesAttr(), self.extent, *own)

    def values(
        self,
        x: np.ndarray,
        v: np.ndarray,
        everything: tuple[Vt.Vec3fArray, Vt.Vec3fArray],
        tension: np.ndarray | None,
    ) -> list[Any]:
        """What the attributes are in a frame; `everything` is x and v as arrays of USD."""
        points, velocities = everything
        if not self._has_all:
            points, velocities = (_usd_vectors(a.take(self._index, axis=0)) for a in (x, v))
        own = [self._along(tension)] if self._along and tension is not None else []
        return [points, velocities, type(self._geometry).ComputeExtent(points, self._widths), *own]


def _usd_vectors(rows: np.ndarray) -> Vt.Vec3fArray:
    """A copy of contiguous float32 rows [n, 3], at once; Vec3fArray.FromNumpy takes 10 times as long."""
    vectors = Vt.Vec3fArray(len(rows))
    ctypes.memmove(np.asarray(vectors).ctypes.data, rows.ctypes.data, rows.nbytes)  # nothing else refers to it yet
    return vectors


def loose_edges(model: Model) -> np.ndarray:
    """Which distances are part of no rope, bool [edge_count]."""
    if not model.ropes:
        return np.ones(len(model.distance), bool)
    return ~_rows_in(
        model.distance.edge, np.concatenate([np.stack([rope[:-1], rope[1:]], axis=1) for rope in model.ropes])
    )


def shown_widths(model: Model) -> np.ndarray:
    """Diameters [m], shape [particle_count]; particles without a radius get one that can be seen."""
    rest = model.distance.rest_length
    shown = SHOWN_WIDTH * float(np.median(rest)) if len(rest) else 0.0
    return np.where(model.radius > 0.0, 2.0 * model.radius, shown or 0.01)


def _rows_in(rows: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Which of `rows` [n, 2] are among `others` [m, 2], in either order of the two."""
    key = np.int64(1) << 32
    pack = [np.sort(r, axis=1).astype(np.int64) @ np.array([key, 1]) for r in (rows, others)]
    return np.isin(pack[0], pack[1])
