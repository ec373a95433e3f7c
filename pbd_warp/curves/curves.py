"""The curves of one BasisCurves prim: checked, as simulation points in world space, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, Vt

from pbd_warp import check
from pbd_warp.curves.basis import LINEAR, Fit, Sampling, Topology
from pbd_warp.curves.material import Material
from pbd_warp.curves.reading import Placement
from pbd_warp.errors import InputError, SimulationFailed

WIDTH = 0.01
"""Diameter [m] of curves that have no widths."""


class Curves:
    """One BasisCurves prim at the frames of a simulation.

    Args:
        prim: The prim.
        time_codes: Of all frames, shape [frames].
        material: What its ropes are made of.

    Attributes:
        topology: Its curves.
        sampling: Its control points as simulation points.
        x: Simulation points at the first frame, in world space [m], float64 [samples, 3].
        width: Diameters there [m], float64 [samples].
        pinned: Which of them are led, bool [samples].
        moving: Whether any of them goes anywhere.

    Raises:
        InputError: what is not finite, does not add up, or is not modelled, by the name of the prim.
    """

    def __init__(self, prim: Usd.Prim, time_codes: np.ndarray, material: Material):
        self.path = str(prim.GetPath())
        self.material = material
        self._geometry = UsdGeom.BasisCurves(prim)
        self._start = start = float(time_codes[0])
        self._placement = Placement(prim, time_codes)
        linear, _ = self._placement.at(start)
        scale = abs(np.linalg.det(linear)) ** (1.0 / 3.0)
        try:
            self.topology = self._read_topology(start)
            self._local = self._read_points(start)
            self._animated = self._geometry.GetPointsAttr().ValueMightBeTimeVarying()
            for time_code in time_codes[1:] if self._animated else ():
                self._read_points(float(time_code))
            self.sampling = Sampling(self.topology)
            self.width = self._read_widths(start, scale)
            self.pinned = self._find_pinned(material.pin or "root", start)
        except InputError as error:
            raise InputError(f"{self.path}: {error}") from None
        self._fit = Fit(self.topology, self.pinned)
        self.x = self._to_world(self.sampling.vertex(self._local), start)
        self.moving = bool(self.pinned.any()) and (self._animated or self._placement.animated)

    @property
    def edges(self) -> np.ndarray:
        """Links between the simulation points, int [links, 2], along each curve; a closed one's last to its first."""
        counts = self.topology.sample_counts
        first = np.cumsum(counts) - counts
        last = first + counts - 1
        begin = np.arange(len(self.x))
        end = begin + 1
        if self.topology.closed:
            end[last] = first
            return np.stack([begin, end], axis=1)
        return np.delete(np.stack([begin, end], axis=1), last, axis=0)

    @property
    def curve(self) -> np.ndarray:
        """The curve of each simulation point, int [samples]."""
        return np.repeat(np.arange(len(self.topology.counts)), self.topology.sample_counts)

    def pins(self, time_code: float) -> np.ndarray:
        """Where the pinned points are in world space [m], shape [pinned, 3]."""
        local = self._read_points(time_code) if self._animated else self._local
        return self._to_world(self.sampling.vertex(local), time_code)[self.pinned]

    def frame(
        self, displacement: np.ndarray, v: np.ndarray, time_code: float, before: float | None, fps: float
    ) -> tuple[np.ndarray, np.ndarray, Any]:
        """A frame in the prim's local space: points and velocities, float32 [vertices, 3], and extent.

        Control points get what the simulation has added to the first frame's, so a curve at rest stays what it is to
        the last bit.

        Args:
            displacement: Of the simulation points since the first frame [m], float64 [samples, 3].
            v: Their velocities [m/s].
            time_code: Of this frame. before: of the one before it, None at the first.
            fps: Frames a second.

        Raises:
            SimulationFailed: a number too large for float32.
        """
        linear, offset = self._placement.at(time_code)
        inverse = np.linalg.inv(linear)
        if self.moving:  # where they belong, without the rounding of the simulation
            displacement, v, now = displacement.copy(), v.copy(), self.pins(time_code)
            displacement[self.pinned] = now - self.x[self.pinned]
            if before is not None:
                v[self.pinned] = (now - self.pins(before)) * fps
        points = self._local + self._fit(displacement) @ inverse
        linear_start, offset_start = self._placement.at(self._start)
        if not (np.array_equal(linear, linear_start) and np.array_equal(offset, offset_start)):
            stayed = (self._local @ linear_start + offset_start - offset) @ inverse
            points += stayed - self._local
        way = self._fit(v)
        if before is not None and self._placement.animated:
            linear_before, offset_before = self._placement.at(before)
            way -= (points @ (linear - linear_before) + (offset - offset_before)) * fps
        with np.errstate(over="ignore"):
            result = points.astype(np.float32), (way @ inverse).astype(np.float32)
        if not all(np.isfinite(values).all() for values in result):
            raise SimulationFailed(f"{self.path} at time code {time_code:g} is not finite in its local space")
        widths = self._geometry.GetWidthsAttr().Get(time_code) or Vt.FloatArray()
        return (*result, UsdGeom.BasisCurves.ComputeExtent(Vt.Vec3fArray.FromNumpy(result[0]), widths))

    def _to_world(self, local: np.ndarray, time_code: float) -> np.ndarray:
        linear, offset = self._placement.at(time_code)
        return local @ linear + offset

    def _read_topology(self, start: float) -> Topology:
        geometry = self._geometry
        if geometry.GetCurveVertexCountsAttr().ValueMightBeTimeVarying():
            raise InputError("curveVertexCounts changes with time, which is not supported: leave it out with --prim")
        counts = np.array(geometry.GetCurveVertexCountsAttr().Get(start) or (), int)
        if not counts.size:
            raise InputError("it has no curves (no curveVertexCounts): leave it out with --prim")
        cubic = geometry.GetTypeAttr().Get() == UsdGeom.Tokens.cubic
        return Topology(geometry.GetBasisAttr().Get() if cubic else LINEAR, geometry.GetWrapAttr().Get(), counts)

    def _read_points(self, time_code: float) -> np.ndarray:
        values = self._geometry.GetPointsAttr().Get(time_code)
        points = np.array(values if values else np.zeros((0, 3)), np.float64)
        total = int(self.topology.counts.sum())
        if len(points) != total:
            raise InputError(
                f"curveVertexCounts add up to {total}, but there are {len(points)} points at time code {time_code:g}"
            )
        return check.vectors(f"points at time code {time_code:g}", points)

    def _read_widths(self, start: float, scale: float) -> np.ndarray:
        """At the simulation points [m]; `scale` is that from local space to world space."""
        primvar = UsdGeom.PrimvarsAPI(self._geometry).GetPrimvar("widths")
        if primvar and primvar.HasValue():  # which goes before the attribute
            widths = self._at_samples("widths", primvar, start)
        elif values := self._geometry.GetWidthsAttr().Get(start):
            widths = self._spread("widths", np.array(values, np.float64), self._geometry.GetWidthsInterpolation())
        else:
            return np.full(self.sampling.count, WIDTH)
        return scale * np.maximum(widths, 0.0)

    def _find_pinned(self, pin: str, start: float) -> np.ndarray:
        pinned = np.zeros(self.sampling.count, bool)
        counts = self.topology.sample_counts
        first = np.cumsum(counts) - counts
        if pin.startswith("primvar:"):
            name = pin.removeprefix("primvar:")
            primvar = UsdGeom.PrimvarsAPI(self._geometry).GetPrimvar(name)
            if not primvar or not primvar.HasValue():
                raise InputError(f"it has no primvar {name!r} to pin by: add one, or pin root, ends or none")
            return self._at_samples(f"primvar {name!r}", primvar, start) >= 0.5
        if pin in ("root", "ends"):
            pinned[first] = True
        if pin == "ends":
            if self.topology.closed:
                raise InputError("a periodic curve has no ends to pin: pin root, none or primvar:NAME")
            pinned[first + counts - 1] = True
        return pinned

    def _at_samples(self, name: str, primvar: UsdGeom.Primvar, start: float) -> np.ndarray:
        values = primvar.ComputeFlattened(start)
        try:
            numbers = np.atleast_1d(np.array(values, np.float64))
        except (TypeError, ValueError):
            numbers = np.zeros((0, 0))
        if numbers.ndim != 1:
            raise InputError(f"{name} is not made of numbers, one each")
        return self._spread(name, numbers, primvar.GetInterpolation())

    def _spread(self, name: str, values: np.ndarray, interpolation: str) -> np.ndarray:
        """One number for each of what the interpolation says, at the simulation points."""
        topology = self.topology
        count, at_samples = {
            UsdGeom.Tokens.constant: (1, lambda values: np.full(self.sampling.count, values[0])),
            UsdGeom.Tokens.uniform: (len(topology.counts), self.sampling.uniform),
            UsdGeom.Tokens.varying: (int(topology.varying_counts.sum()), self.sampling.varying),
            UsdGeom.Tokens.vertex: (int(topology.counts.sum()), self.sampling.vertex),
        }.get(interpolation, (-1, None))
        if at_samples is None:
            raise InputError(f"{name} has interpolation {interpolation!r}: use constant, uniform, varying or vertex")
        if len(values) != count:
            raise InputError(f"{name} must be {count} for interpolation {interpolation!r}, but there are {len(values)}")
        if not np.isfinite(values).all():
            raise InputError(f"{name} must be finite, but number {np.flatnonzero(~np.isfinite(values))[0]} is not")
        return at_samples(values)
