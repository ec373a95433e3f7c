"""Values of curves at their simulation points: widths, and primvars to pin by."""

from __future__ import annotations

import numpy as np
from pxr import UsdGeom, Vt

from pbd_warp.curves.attributes import changes, numbers_of
from pbd_warp.curves.sampling import Kind, Sampling
from pbd_warp.errors import InputError

INTERPOLATIONS = ("constant", "uniform", "varying", "vertex")


class Primvars:
    """Of one prim, at the first frame.

    Args:
        geometry: The prim. kind: of its curves. time_codes: of all frames.
    """

    def __init__(self, geometry: UsdGeom.Curves, kind: Kind, time_codes: np.ndarray):
        self._geometry = geometry
        self._kind = kind
        self._time_codes = time_codes

    def widths(self, sampling: Sampling) -> np.ndarray | None:
        """Diameters in local space, float64 [samples]; None where there are none.

        Raises:
            InputError: they do not add up.
        """
        start = float(self._time_codes[0])
        primvar = self._width_primvar
        if primvar and primvar.HasValue():  # which goes before the attribute
            values, interpolation = numbers_of("widths", primvar, start), primvar.GetInterpolation()
        else:
            attribute = self._geometry.GetWidthsAttr()
            values = np.array(attribute.Get(start) or (), np.float64)
            interpolation = self._geometry.GetWidthsInterpolation()
            if not attribute.HasAuthoredMetadata("interpolation"):  # "vertex" then, which not all exporters know
                interpolation = self._guess(len(values)) or interpolation
        if not len(values):
            return None
        return self._spread("widths", values, "constant" if len(values) == 1 else interpolation, sampling)

    @property
    def _width_primvar(self) -> UsdGeom.Primvar:
        return UsdGeom.PrimvarsAPI(self._geometry).FindPrimvarWithInheritance("widths")

    def shown_widths(self, time_code: float) -> Vt.FloatArray:
        """What USD makes extents with at a frame; what is negative or not finite is 0, or they would be neither."""
        widths = np.array(self._geometry.GetWidthsAttr().Get(time_code) or (), np.float32)
        return Vt.FloatArray.FromNumpy(np.where(np.isfinite(widths), np.maximum(widths, 0.0), 0.0).astype(np.float32))

    def later_width_faults(self) -> list[str]:
        """A sentence on the first of the later frames at which a width is negative or not finite, if there is one."""
        attribute = self._geometry.GetWidthsAttr()
        for time_code in map(float, self._time_codes[1:]):
            widths = np.array(attribute.Get(time_code) or (), np.float64)
            bad = np.flatnonzero(~np.isfinite(widths) | (widths < 0.0))
            if bad.size:
                return [f"width {bad[0]} is {widths[bad[0]]:g} at time code {time_code:g}: in extents it counts as 0"]
        return []

    @property
    def widths_change(self) -> bool:
        """Whether they do with time."""
        primvar = self._width_primvar
        used = primvar.GetAttr() if primvar and primvar.HasValue() else self._geometry.GetWidthsAttr()
        return changes(used, self._time_codes)

    def numbers(self, name: str, sampling: Sampling) -> np.ndarray:
        """A primvar of numbers, float64 [samples].

        Raises:
            InputError: there is none, it is no such primvar, it does not add up, or changes with time.
        """
        primvar = UsdGeom.PrimvarsAPI(self._geometry).FindPrimvarWithInheritance(name)
        if not primvar or not primvar.HasValue():
            raise InputError(f"it has no primvar {name!r} to pin by: add one, or pin root, ends or none")
        title = f"primvar {name!r}"
        values = numbers_of(title, primvar, float(self._time_codes[0]))
        if any(changes(attribute, self._time_codes) for attribute in (primvar.GetAttr(), primvar.GetIndicesAttr())):
            raise InputError(f"{title} changes with time, which is not supported")
        found = self._spread(title, values, primvar.GetInterpolation(), sampling)
        if not np.isfinite(found).all():
            raise InputError(f"{title} must be finite")
        return found

    def _counts(self) -> dict[str, int]:
        """How many values an interpolation has."""
        kind = self._kind
        return {
            "constant": 1,
            "uniform": len(kind.counts),
            "varying": int(kind.varying_counts.sum()),
            "vertex": int(kind.counts.sum()),
        }

    def _guess(self, count: int) -> str | None:
        counts = self._counts()
        return next((name for name in ("vertex", "varying", "uniform", "constant") if counts[name] == count), None)

    def _spread(self, name: str, values: np.ndarray, interpolation: str, sampling: Sampling) -> np.ndarray:
        if interpolation not in INTERPOLATIONS:
            raise InputError(f"{name} has interpolation {interpolation!r}: use {', '.join(INTERPOLATIONS)}")
        needed = self._counts()[interpolation]
        if len(values) != needed:
            raise InputError(
                f"{name} must be {needed} for interpolation {interpolation!r}, but there are {len(values)}"
            )
        if interpolation == "constant":
            return np.full(sampling.count, values[0])
        return getattr(sampling, interpolation)(values)
