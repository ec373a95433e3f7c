"""Reads what type of curves a prim has."""

from __future__ import annotations

import numpy as np
from pxr import Usd, UsdGeom

from pbd_warp.curves.attributes import constant
from pbd_warp.curves.basis import LINEAR, BasisKind
from pbd_warp.curves.hermite import HermiteKind
from pbd_warp.curves.nurbs import NurbsKind
from pbd_warp.curves.sampling import Kind
from pbd_warp.errors import InputError


def read_kind(prim: Usd.Prim, counts: np.ndarray, points: np.ndarray, time_codes: np.ndarray) -> Kind:
    """The kind of a BasisCurves, NurbsCurves or HermiteCurves prim.

    Args:
        counts: Control points of each curve. points: All of them at the first frame, shape [total, 3].

    Raises:
        InputError: another type, values that make no sense or change with time.
    """
    if prim.IsA(UsdGeom.HermiteCurves):
        return HermiteKind(counts)
    if prim.IsA(UsdGeom.NurbsCurves):
        nurbs = UsdGeom.NurbsCurves(prim)
        order, knots, ranges, weights = (
            constant(attribute, time_codes)
            for attribute in (
                *(nurbs.GetOrderAttr(), nurbs.GetKnotsAttr(), nurbs.GetRangesAttr()),
                nurbs.GetPointWeightsAttr(),
            )
        )
        return NurbsKind(
            counts,
            np.array(order or (), int),
            np.array(knots or (), np.float64),
            np.array(ranges or np.zeros((0, 2)), np.float64),
            np.array(weights or (), np.float64),
            points,
        )
    if prim.IsA(UsdGeom.BasisCurves):
        basis = UsdGeom.BasisCurves(prim)
        kind, name, wrap = (
            constant(attribute, time_codes)
            for attribute in (basis.GetTypeAttr(), basis.GetBasisAttr(), basis.GetWrapAttr())
        )
        return BasisKind(name if kind == UsdGeom.Tokens.cubic else LINEAR, wrap, counts, points)
    raise InputError(f"it is a {prim.GetTypeName()}, which is none of BasisCurves, NurbsCurves and HermiteCurves")
