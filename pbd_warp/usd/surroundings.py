"""What stands around the motion in a USD file: colliders, a camera, a light."""

from __future__ import annotations

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux, Vt

from pbd_warp.kernels.shapes import PLANE, SPHERE
from pbd_warp.model.colliders import Colliders
from pbd_warp.usd.space import Space

COLLIDER_COLOUR = (0.55, 0.55, 0.55)

CAMERA_MARGIN = 1.15
"""How much more than the motion the camera sees."""


class Surroundings:
    """Colliders, camera and light, which depend on where the motion goes: worked out in the model's space, written in
    that of the file."""

    def __init__(self, stage: Usd.Stage, colliders: Colliders, space: Space):
        self._stage = stage
        self._colliders = colliders
        self._space = space
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def include(self, extent: Vt.Vec3fArray) -> None:
        """The motion goes here too; as the file has it."""
        corners = self._space.back(np.array(extent, np.float64))
        self._low = np.minimum(self._low, corners.min(axis=0))
        self._high = np.maximum(self._high, corners.max(axis=0))

    def define(self) -> None:
        """Define them for the motion so far."""
        if self._low[0] > self._high[0]:
            return  # no frame yet, or those that are resumed are still to be read
        for name in ("Colliders", "Camera", "Light"):
            self._stage.RemovePrim(f"/World/{name}")
        centre = 0.5 * (self._low + self._high)
        # A single resting particle still has a surrounding.
        size = np.maximum(self._high - self._low, 1e-3)
        self._define_colliders(centre, float(2.0 * np.linalg.norm(size)))
        self._define_camera(centre, size)
        light = UsdLux.DistantLight.Define(self._stage, "/World/Light")
        light.CreateIntensityAttr(3.0)
        self._place(light, None, Gf.Vec3f(-40, 25, 0))

    def _place(self, xformable: UsdGeom.Xformable, point: np.ndarray | None, turned: Gf.Vec3f) -> None:
        """Put something that would be turned so with y up."""
        if point is not None:
            xformable.AddTranslateOp().Set(Gf.Vec3d(*self._space(point)))
        if self._space.up_axis == UsdGeom.Tokens.z:
            xformable.AddRotateXOp(opSuffix="up").Set(90.0)
        xformable.AddRotateXYZOp().Set(turned)

    def _define_colliders(self, centre: np.ndarray, size: float) -> None:
        c = self._colliders
        if len(c.kind):
            UsdGeom.Scope.Define(self._stage, "/World/Colliders")
        for number, (kind, point, form) in enumerate(zip(c.kind, c.centre, c.size, strict=True)):
            gprim: UsdGeom.Gprim
            if kind == SPHERE:
                gprim = UsdGeom.Sphere.Define(self._stage, f"/World/Colliders/Sphere_{number}")
                gprim.CreateRadiusAttr(float(self._space.length(form[0])))
                gprim.AddTranslateOp().Set(Gf.Vec3d(*self._space(point)))
            elif kind == PLANE:
                normal = form
                gprim = UsdGeom.Plane.Define(self._stage, f"/World/Colliders/Plane_{number}")
                gprim.CreateAxisAttr(UsdGeom.Tokens.z)
                gprim.CreateWidthAttr(self._space.length(size))
                gprim.CreateLengthAttr(self._space.length(size))
                # The part of the infinite plane that lies nearest to the motion.
                foot = centre - normal * ((centre - point) @ normal)
                gprim.AddTranslateOp().Set(Gf.Vec3d(*self._space(foot)))
                rotation = Gf.Rotation(Gf.Vec3d.ZAxis(), Gf.Vec3d(*self._space.turn(normal)))
                gprim.AddOrientOp().Set(Gf.Quatf(rotation.GetQuat()))
            gprim.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(gprim, Usd.TimeCode.Default()))
            gprim.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([Gf.Vec3f(*COLLIDER_COLOUR)])

    def _define_camera(self, centre: np.ndarray, size: np.ndarray) -> None:
        """Face-on: looks along the axis in which the motion is flattest."""
        camera = UsdGeom.Camera.Define(self._stage, "/World/Camera")
        flat = flattest_axis(size)
        right, up = ((2, 1), (0, 2), (0, 1))[flat]
        half_width = 0.5 * camera.GetHorizontalApertureAttr().Get() / camera.GetFocalLengthAttr().Get()
        half_height = 0.5 * camera.GetVerticalApertureAttr().Get() / camera.GetFocalLengthAttr().Get()
        distance = CAMERA_MARGIN * 0.5 * max(size[right] / half_width, size[up] / half_height) + 0.5 * size[flat]
        eye = centre.copy()
        eye[flat] += distance
        shown = self._space.length(distance)
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * shown, 100.0 * shown))
        self._place(camera, eye, (Gf.Vec3f(0, 90, 0), Gf.Vec3f(-90, 0, 0), Gf.Vec3f(0, 0, 0))[flat])


def flattest_axis(size: np.ndarray) -> int:
    """The axis to look along; of equal ones the later, so z before y before x. size: extents [3]."""
    return 2 - int(np.argmin(size[::-1]))
