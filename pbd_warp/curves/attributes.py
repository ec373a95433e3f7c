"""Values of attributes as they are at a frame: samples in time count as much as values without."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom

from pbd_warp.errors import InputError


def check_types(prim: Usd.Prim) -> None:
    """Raise an InputError where an attribute of a prim has another type than its schema says: USD gives its value all
    the same."""
    definition = prim.GetPrimDefinition()
    for attribute in prim.GetAuthoredAttributes():
        expected = definition.GetSchemaAttributeSpec(attribute.GetName())
        for spec in attribute.GetPropertyStack(Usd.TimeCode.Default()) if expected else ():
            if not isinstance(spec, Sdf.AttributeSpec) or spec.typeName.type != expected.typeName.type:
                found = spec.typeName if isinstance(spec, Sdf.AttributeSpec) else "a relationship"
                raise InputError(f"{attribute.GetPath()} is {found}, where USD has {expected.typeName}")


def with_ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """A prim and all that it is in, the innermost first."""
    while prim and not prim.IsPseudoRoot():
        yield prim
        prim = prim.GetParent()


def changes(attribute: Usd.Attribute, time_codes: np.ndarray) -> bool:
    """Whether its samples that show between the first and the last frame differ; that there are many does not say so.
    The samples are compared, not the frames: between two equal ones USD interpolates with rounding."""
    if not attribute or not attribute.ValueMightBeTimeVarying():
        return False
    first, last = float(time_codes[0]), float(time_codes[-1])
    around = [*attribute.GetBracketingTimeSamples(first), *attribute.GetBracketingTimeSamples(last)]
    samples = {*attribute.GetTimeSamplesInInterval(Gf.Interval(first, last)), *around}
    value = attribute.Get(around[0])
    return any(attribute.Get(sample) != value for sample in samples)


def constant(attribute: Usd.Attribute, time_codes: np.ndarray) -> Any:
    """Its value at all frames, None where it has none.

    Raises:
        InputError: it changes.
    """
    if changes(attribute, time_codes):
        raise InputError(f"{attribute.GetName()} changes with time, which is not supported")
    return attribute.Get(float(time_codes[0])) if attribute else None


def own_setting(prim: Usd.Prim, name: str, time_codes: np.ndarray) -> Any:
    """The value of pbd:NAME on a prim, None where it has none."""
    return constant(prim.GetAttribute(f"pbd:{name}"), time_codes)


def numbers_of(name: str, primvar: UsdGeom.Primvar, time_code: float) -> np.ndarray:
    """The values of a primvar that is made of single numbers, float64 [n].

    Raises:
        InputError: it is made of something else.
    """
    values = primvar.ComputeFlattened(time_code)
    try:
        numbers = np.atleast_1d(np.array(values, np.float64))
    except (TypeError, ValueError):
        numbers = np.zeros((0, 0))
    if numbers.ndim != 1:
        raise InputError(f"{name} is not made of numbers, one each")
    return numbers
