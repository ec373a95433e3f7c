"""The curves of one prim: checked, as simulation points in world space, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Usd, UsdGeom, Vt

from pbd_warp.curves.attributes import changes, check_types, with_ancestors
from pbd_warp.curves.fit import Fit
from pbd_warp.curves.kinds import read_kind
from pbd_warp.curves.material import Material
from pbd_warp.curves.placement import Placement
from pbd_warp.curves.primvars import Primvars
from pbd_warp.curves.sampling import Sampling
from pbd_warp.curves.skinning import Skinning
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.usd.tension import AlongCurves, usd_floats

WIDTH = 0.01
"""Diameter [m] of curves that have no widths."""

THINNEST = 0.01
"""Part of a curve's largest width that counts at least: a tip without width would have no mass."""


class Curves:
    """One prim's curves at the frames of a simulation. Some of them may be left as they are.

    Args:
        prim: The prim.
        time_codes: Of all frames, shape [frames].
        material: What its ropes are made of.
        skinning: What deforms it.

    Attributes:
        left: Why some curves are not simulated, by number.
        notes: What is unusual, in a sentence each.
        sampling: Its control points as simulation points.
        x: Simulation points at the first frame, in world space [m], float64 [samples, 3].
        width: Diameters there [m], float64 [samples].
        pinned: Which of them are led, bool [samples].
        moving: Whether any of them goes anywhere.

    Raises:
        InputError: what is not modelled or does not add up, or no curve is left to simulate.
    """

    def __init__(self, prim: Usd.Prim, time_codes: np.ndarray, material: Material, skinning: Skinning | None = None):
        self.path = str(prim.GetPath())
        self.prim = prim
        self.material = material
        self.skinning = skinning
        self.left: dict[int, str] = {}
        self.notes: list[str] = []
        for each in with_ancestors(prim):
            check_types(each)
        self._geometry = UsdGeom.Curves(prim)
        self._tangents = UsdGeom.HermiteCurves(prim).GetTangentsAttr() if prim.IsA(UsdGeom.HermiteCurves) else None
        if self._tangents and skinning:
            raise InputError("it is bound to a skeleton, which does not deform the tangents of HermiteCurves")
        self._start = start = float(time_codes[0])
        self._placement = Placement(prim, time_codes)
        counts = self._read_counts(time_codes)
        self._curve = np.tile(np.repeat(np.arange(len(counts)), counts), 2 if self._tangents else 1)
        self._local = self._read(start)
        self._animated = self._read_all(time_codes)
        self.kind = read_kind(prim, counts, self._local, time_codes)
        self._primvars = Primvars(self._geometry, self.kind, time_codes)
        self.leave({**self.kind.faults, **self._not_finite(start, self._local)})

    @property
    def attributes(self) -> tuple[str, ...]:
        """The names of what `frame` gives."""
        return ("points", "velocities", "extent", *(("tangents",) if self._tangents else ()))

    def tension(self, links: np.ndarray) -> Vt.FloatArray:
        """Of its links [N], as the values of `primvars:tension`, "varying"; 0 of curves that are left."""
        points = AlongCurves(self.sampling.edges, self.sampling.count)(links)
        return usd_floats(self.sampling.to_varying(points))

    def leave(self, reasons: dict[int, str]) -> None:
        """Leave some curves as they are.

        Raises:
            InputError: none is left to simulate.
        """
        self.left = {**reasons, **self.left}
        simulated = np.ones(len(self.kind.counts), bool)
        simulated[list(self.left)] = False
        if not simulated.any():
            curve = min(self.left)
            raise InputError(
                f"curve {curve} cannot be simulated: {self.left[curve]}" if self.left else "it has no curves"
            )
        self.sampling = Sampling(self.kind, simulated)
        linear, _ = self._placement.at(self._start)
        width = self._find_widths(abs(np.linalg.det(linear)) ** (1.0 / 3.0))
        bad = np.unique(self.sampling.curve[~np.isfinite(width)])
        if bad.size:
            self.leave(dict.fromkeys(bad.tolist(), "one of its widths is not finite"))
            return
        self.width = width
        self.pinned = self._find_pinned(self.material.pin or "root")
        self._fit = Fit(self.sampling, self.pinned)
        self.x = self._to_world(self.sampling.points(self._local), self._start)
        self.moving = bool(self.pinned.any()) and (self._animated or self._placement.animated)

    def name(self, sample: int) -> str:
        """A simulation point in words."""
        curve = int(self.sampling.curve[sample])
        number = sample - int(self.sampling.sample_counts[:curve].sum())
        return f"point {number} of curve {curve} of {self.path}"

    def pins(self, time_code: float) -> np.ndarray:
        """Where the pinned points are in world space [m], shape [pinned, 3]."""
        local = self._read(time_code) if self._animated else self._local
        return self._to_world(self.sampling.points(local)[self.pinned], time_code)

    def frame(
        self, displacement: np.ndarray, v: np.ndarray, time_code: float, before: float | None, fps: float
    ) -> list[Any]:
        """A frame in the prim's local space: the values of `attributes`, as arrays of USD.

        Control points get what the simulation has added to the first frame's, so a curve at rest stays what it is to
        the last bit. Curves that are left are as they are in the input.

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
        values = self._local + self._fit(displacement) @ inverse
        count = int(self.kind.counts.sum())
        linear_start, offset_start = self._placement.at(self._start)
        if not (np.array_equal(linear, linear_start) and np.array_equal(offset, offset_start)):
            moved = np.zeros((len(values), 3))
            moved[:count] = offset_start - offset  # which tangents do not feel
            values += (self._local @ linear_start + moved) @ inverse - self._local
        way = self._fit(v)[:count]
        if before is not None and self._placement.animated:
            linear_before, offset_before = self._placement.at(before)
            way -= (values[:count] @ (linear - linear_before) + (offset - offset_before)) * fps
        way = way @ inverse
        if self.left:
            still = self.sampling.unknown < 0
            values[still] = self._read(time_code)[still] if self._animated else self._local[still]
            way[still[:count]] = 0.0
        with np.errstate(over="ignore"):
            values, way = values.astype(np.float32), way.astype(np.float32)
        kept = self.sampling.unknown >= 0
        if not (np.isfinite(values[kept]).all() and np.isfinite(way).all()):
            raise SimulationFailed(f"{self.path} at time code {time_code:g} is not finite in its local space")
        points = Vt.Vec3fArray.FromNumpy(values[:count])
        extent = UsdGeom.Curves.ComputeExtent(points, self._primvars.shown_widths(time_code))
        frame = [points, Vt.Vec3fArray.FromNumpy(way), extent]
        return [*frame, Vt.Vec3fArray.FromNumpy(values[count:])] if self._tangents else frame

    def _to_world(self, local: np.ndarray, time_code: float) -> np.ndarray:
        linear, offset = self._placement.at(time_code)
        return local @ linear + offset

    def _read_counts(self, time_codes: np.ndarray) -> np.ndarray:
        attribute = self._geometry.GetCurveVertexCountsAttr()
        if changes(attribute, time_codes):
            raise InputError("curveVertexCounts changes with time, which is not supported")
        counts = np.array(attribute.Get(self._start) or (), int)
        if not counts.size:
            raise InputError("it has no curves (no curveVertexCounts)")
        return np.maximum(counts, 0)

    def _read(self, time_code: float) -> np.ndarray:
        """Control points, then tangents, in local space, float64 [values, 3]."""
        found = []
        total = len(self._curve) // (2 if self._tangents else 1)
        for attribute in (self._geometry.GetPointsAttr(), self._tangents):
            if attribute is None:
                continue
            values = attribute.Get(time_code)
            count = len(values) if values is not None else 0
            if count != total:
                raise InputError(
                    f"curveVertexCounts add up to {total}, but there are {count} {attribute.GetName()} at time code "
                    f"{time_code:g}"
                )
            found.append(self.skinning(values, time_code) if self.skinning else np.array(values, np.float64))
        return np.concatenate(found)

    def _read_all(self, time_codes: np.ndarray) -> bool:
        """Whether the input's points go anywhere; what is not finite at some frame is left."""
        attributes = [self._geometry.GetPointsAttr(), *([self._tangents] if self._tangents else [])]
        if not self.skinning and not any(changes(attribute, time_codes) for attribute in attributes):
            return False
        animated = False
        for time_code in map(float, time_codes[1:]):
            values = self._read(time_code)
            animated |= not np.array_equal(values, self._local)
            self.left.update({c: t for c, t in self._not_finite(time_code, values).items() if c not in self.left})
        return animated

    def _not_finite(self, time_code: float, values: np.ndarray) -> dict[int, str]:
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        total = len(values) // (2 if self._tangents else 1)
        return {
            int(self._curve[i]): f"{'points' if i < total else 'tangents'} at time code {time_code:g} must be finite, "
            f"but number {i % total} is ({', '.join(f'{c:g}' for c in values[i])})"
            for i in bad[::-1]
        }

    def _find_widths(self, scale: float) -> np.ndarray:
        """At the simulation points [m]; `scale` is that from local space to world space."""
        try:
            width = self._primvars.widths(self.sampling)
        except InputError as error:
            width, self.notes = None, [f"{error}: it is simulated as {1e3 * WIDTH:g} mm wide"]
        if self._primvars.widths_change:
            self.notes = ["its widths change with time: it is simulated with those of the first frame"]
            self.notes += self._primvars.later_width_faults()
        if width is None:
            return np.full(self.sampling.count, WIDTH)
        width = scale * np.maximum(width, 0.0)
        widest = np.zeros(len(self.kind.counts))
        np.maximum.at(widest, self.sampling.curve, np.nan_to_num(width))
        widest = widest[self.sampling.curve]
        return np.where(widest > 0.0, np.maximum(width, THINNEST * widest), WIDTH + 0.0 * width)

    def _find_pinned(self, pin: str) -> np.ndarray:
        sampling = self.sampling
        if pin.startswith("primvar:"):
            return self._primvars.numbers(pin.removeprefix("primvar:"), sampling) >= 0.5
        pinned = np.zeros(sampling.count, bool)
        if pin in ("root", "ends"):
            pinned[sampling.first] = True
        if pin == "ends":
            if sampling.closed.any():
                raise InputError("a periodic curve has no ends to pin: pin root, none or primvar:NAME")
            pinned[sampling.last] = True
        return pinned
