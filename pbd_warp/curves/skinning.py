"""Curves bound to a skeleton or with blend shapes: what a renderer would make of their points.

A renderer deforms the points that it finds, so simulated points of a bound curve would be deformed once more. Here the
deformed points are what is simulated, and the layer that is written unbinds the curve.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Usd, UsdGeom, UsdSkel, Vt

from pbd_warp.errors import InputError


@dataclass(frozen=True)
class Skinning:
    """Of one prim; its skeleton and binding as UsdSkel sees them."""

    prim: Usd.Prim
    skeleton: UsdSkel.SkeletonQuery
    binding: UsdSkel.SkinningQuery

    def __call__(self, points: Vt.Vec3fArray, time_code: float) -> np.ndarray:
        """Points as they are shown, in the prim's local space, shape [n, 3].

        Raises:
            InputError: joints or blend shapes do not fit the points.
        """
        path = self.skeleton.GetPrim().GetPath()
        points = Vt.Vec3fArray(points)
        if self.binding.HasBlendShapes() and self.skeleton.GetAnimQuery():
            points = self._blend(points, time_code)
        if not self.binding.HasJointInfluences():
            return np.array(points, np.float64)
        joints = self.skeleton.ComputeSkinningTransforms(time_code)
        if joints is None:
            raise InputError(f"the joints of its skeleton {path} have no transforms at time code {time_code:g}")
        if self.binding.IsRigidlyDeformed():
            matrix = np.array(self.binding.ComputeSkinnedTransform(joints, time_code))
            skinned = np.array(points, np.float64) @ matrix[:3, :3] + matrix[3, :3]
        else:
            if not self.binding.ComputeSkinnedPoints(joints, points, time_code):
                raise InputError(f"the joint indices and weights do not fit its points or its skeleton {path}")
            skinned = np.array(points, np.float64)
        skeleton_space, own_space = (
            np.array(UsdGeom.Imageable(prim).ComputeLocalToWorldTransform(time_code))
            for prim in (self.skeleton.GetPrim(), self.prim)
        )
        matrix = skeleton_space @ np.linalg.inv(own_space)
        return skinned @ matrix[:3, :3] + matrix[3, :3]

    def _blend(self, points: Vt.Vec3fArray, time_code: float) -> Vt.Vec3fArray:
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(self.prim))
        weights = self.skeleton.GetAnimQuery().ComputeBlendShapeWeights(time_code)
        weights = self.binding.GetBlendShapeMapper().Remap(weights)
        if weights is None:
            raise InputError("its blend shapes have no weights")
        parts = shapes.ComputeSubShapeWeights(weights)
        there = shapes.ComputeBlendShapePointIndices(), shapes.ComputeSubShapePointOffsets()
        if not shapes.ComputeDeformedPoints(*parts, *there, points):
            raise InputError("its blend shapes do not fit its points")
        return points


class Skeletons:
    """The skeletons of a stage."""

    def __init__(self) -> None:
        self._cache = UsdSkel.Cache()
        self._known: set[str] = set()

    def skinning(self, prim: Usd.Prim) -> Skinning | None:
        """What deforms a prim; None where nothing does."""
        root = UsdSkel.Root.Find(prim)
        if not root:
            return None
        if str(root.GetPath()) not in self._known:
            self._cache.Populate(root, Usd.TraverseInstanceProxies())
            self._known.add(str(root.GetPath()))
        skeleton = UsdSkel.BindingAPI(prim).GetInheritedSkeleton()
        binding = self._cache.GetSkinningQuery(prim)
        if not skeleton or not binding or not (binding.HasJointInfluences() or binding.HasBlendShapes()):
            return None
        query = self._cache.GetSkelQuery(skeleton)
        if not query:
            raise InputError(f"it is bound to {skeleton.GetPath()}, which is no valid skeleton")
        return Skinning(prim, query, binding)


def moved_by_others(prim: Usd.Prim) -> str:
    """What else may change a prim's points or place after they are written, in a sentence; or nothing."""
    found = []
    while prim and not prim.IsPseudoRoot():
        schemas = [name for name in prim.GetAppliedSchemas() if "RigidBody" in name or "Deformable" in name]
        if "Procedural" in prim.GetTypeName():
            schemas.append(prim.GetTypeName())
        found += [f"{name} of {prim.GetPath()}" for name in schemas]
        prim = prim.GetParent()
    return f"{', '.join(found)} may move it once more where that is evaluated" if found else ""


def unbind(stage: Usd.Stage, path: str) -> None:
    """Have the renderer show the points of a prim as they are written."""
    stage.OverridePrim(path).CreateRelationship("skel:skeleton", False).SetTargets([])
