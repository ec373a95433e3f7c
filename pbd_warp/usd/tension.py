"""Tensions of links as a primvar of the curves that run along them."""

from __future__ import annotations

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from pbd_warp.errors import InputError
from pbd_warp.model.model import Model

PRIMVAR = "primvars:tension"
"""In newtons, whatever the stage's units, pull positive."""


def define_tension(prim: Usd.Prim) -> Usd.Attribute:
    """The attribute, a value for each end of a segment."""
    attribute = prim.CreateAttribute(PRIMVAR, Sdf.ValueTypeNames.FloatArray, False)
    UsdGeom.Primvar(attribute).SetInterpolation(UsdGeom.Tokens.varying)
    return attribute


class AlongCurves:
    """Of a link to each segment of curves: values at their points, the mean of the two links that meet there, at an end
    that of the one.

    Args:
        segments: The points that each joins, in the direction of its curve, int [segment_count, 2].
        count: Points of all curves.
    """

    def __init__(self, segments: np.ndarray, count: int):
        number = np.arange(len(segments))
        before, after = np.full(count, -1), np.full(count, -1)
        before[segments[:, 1]], after[segments[:, 0]] = number, number
        self._before, self._after = np.where(before < 0, after, before), np.where(after < 0, before, after)

    def __call__(self, tension: np.ndarray) -> np.ndarray:
        """[segment_count] to [count]."""
        return 0.5 * (tension[self._before] + tension[self._after])


class AlongChains:
    """The same for curves along chains of a model's particles, each joined to the next by one distance or several.

    Raises:
        InputError: two neighbours that no distance joins.
    """

    def __init__(self, model: Model, chains: list[np.ndarray]):
        counts = np.array([len(chain) for chain in chains])
        particle = np.concatenate(chains)
        begin = np.delete(np.arange(len(particle)), np.cumsum(counts) - 1)
        self._along = AlongCurves(np.stack([begin, begin + 1], axis=1), len(particle))
        wanted = _keys(particle[np.stack([begin, begin + 1], axis=1)])
        there, self._pair = np.unique(_keys(model.distance.edge), return_inverse=True)
        self._segment = np.minimum(np.searchsorted(there, wanted), len(there) - 1)
        if not len(there) or np.any(there[self._segment] != wanted):
            raise InputError("a rope has neighbours that no distance joins: there is no tension to write")

    def __call__(self, tension: np.ndarray) -> Vt.FloatArray:
        """Of tensions [distance_count], at the particles of all chains."""
        return usd_floats(self._along(np.bincount(self._pair, tension)[self._segment]))


def usd_floats(values: np.ndarray) -> Vt.FloatArray:
    return Vt.FloatArray.FromNumpy(values.astype(np.float32))


def _keys(pairs: np.ndarray) -> np.ndarray:
    """One number for each pair of particles, in either order."""
    return np.sort(pairs, axis=1).astype(np.int64) @ np.array([np.int64(1) << 32, 1])
