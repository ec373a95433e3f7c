"""Finds prims in a stage: the curves to simulate, those that can have no points of their own, colliders."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Sequence

from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from pbd_warp.errors import InputError

MARK = "pbd:mark"

PHYSICS = "physics"
"""The pattern for everything that has UsdPhysics.CollisionAPI."""


def matches(path: str, pattern: str) -> bool:
    """Whether a prim or one of its ancestors has a path that matches the pattern (* ? [])."""
    parts = path.split("/")
    return any(fnmatch.fnmatchcase("/".join(parts[:end]), pattern) for end in range(2, len(parts) + 1))


def find_curves(stage: Usd.Stage, patterns: Sequence[str] = (), skip: Sequence[str] = ()) -> list[Usd.Prim]:
    """The curves of a stage that match one of the patterns (all without patterns) and none of `skip`.

    Raises:
        InputError: none are there or left, or a pattern matches none.
    """
    every = [prim for prim in _prims(stage) if prim.IsA(UsdGeom.Curves)]
    if not every:
        raise InputError("the stage has no curves (BasisCurves, NurbsCurves, HermiteCurves): nothing to simulate")
    for option, given in ("--prim", patterns), ("--skip", skip):
        for pattern in given:
            if not any(matches(_path(prim), pattern) for prim in every):
                some = ", ".join(_path(prim) for prim in every[:5]) + (", ..." if len(every) > 5 else "")
                raise InputError(f"{option} {pattern} matches no curves: there is {some}")
    chosen = [prim for prim in every if not patterns or any(matches(_path(prim), pattern) for pattern in patterns)]
    chosen = [prim for prim in chosen if not any(matches(_path(prim), pattern) for pattern in skip)]
    if not chosen:
        raise InputError(f"--skip {' --skip '.join(skip)} leaves no curves to simulate")
    return chosen


def without_own_points(stage: Usd.Stage, chosen: Sequence[Usd.Prim]) -> dict[str, str]:
    """Why some of the prims cannot have points of their own, by path."""
    instancers = [UsdGeom.PointInstancer(prim) for prim in _prims(stage) if prim.IsA(UsdGeom.PointInstancer)]
    prototypes = [target for each in instancers for target in each.GetPrototypesRel().GetForwardedTargets()]
    reasons = {}
    for prim in chosen:
        if prim.IsInstanceProxy():
            reasons[_path(prim)] = (
                "it is part of an instance, which cannot have points of its own: set instanceable = false to have it so"
            )
        elif any(prim.GetPath().HasPrefix(prototype) for prototype in prototypes):
            reasons[_path(prim)] = "it is a prototype of a PointInstancer, whose copies cannot move each by itself"
    return reasons


def shared_with_others(stage: Usd.Stage, paths: Sequence[str]) -> dict[str, str]:
    """Why some prims cannot be overridden: others, none of `paths`, would change with them.

    Composition itself is asked: a mark is put where the points would go, and looked for everywhere.
    """
    layer = stage.GetSessionLayer()
    with Sdf.ChangeBlock():
        for path in paths:
            spec = Sdf.AttributeSpec(Sdf.CreatePrimInLayer(layer, path), MARK, Sdf.ValueTypeNames.String)
            spec.default = path
    found: dict[str, list[str]] = {}
    for prim in _prims(stage):
        mark = prim.GetAttribute(MARK)
        if mark and mark.Get() != _path(prim):
            found.setdefault(mark.Get(), []).append(_path(prim))
    layer.Clear()
    reasons = {}
    for path, others in found.items():
        more = f" and {len(others) - 1} more" if len(others) > 1 else ""
        reasons[path] = (
            f"{others[0]}{more} takes it over (by a reference, inherit, specialize or payload) and would change with "
            "it: simulate that one too, or set instanceable = false there if it is an instance"
        )
    return reasons


def find_colliders(stage: Usd.Stage, patterns: Sequence[str]) -> list[Usd.Prim]:
    """The geometry that matches one of the patterns."""
    every = [prim for prim in _prims(stage) if prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer)]
    found = []
    for pattern in patterns:
        if pattern == PHYSICS:
            matching = [prim for prim in every if prim.HasAPI(UsdPhysics.CollisionAPI)]
            matching = [prim for prim in matching if UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get()]
        else:
            matching = [prim for prim in every if matches(_path(prim), pattern)]
        if not matching:
            raise InputError(f"--collide {pattern} matches no geometry: give the path of a mesh, a solid or a plane")
        # What holds curves and solids means the solids.
        solid = [prim for prim in matching if not prim.IsA(UsdGeom.Curves)]
        found += solid or matching
    return [prim for prim in every if prim in found]


def _prims(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    return iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))


def _path(prim: Usd.Prim) -> str:
    return str(prim.GetPath())
