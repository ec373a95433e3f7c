"""What stands around the motion in a USD file: colliders, a camera, a light."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Gf, Usd, UsdGeom, UsdLux, Vt

from pbd_warp.kernels.shapes import BOX, CAPSULE, CONE, MESH, PLANE, SPHERE
from pbd_warp.model.colliders import Colliders
from pbd_warp.model.rotation import after, quaternion
from pbd_warp.model.tessellation import tessellated
from pbd_warp.usd.space import Space

COLLIDER_COLOUR = (0.55, 0.55, 0.55)

CAMERA_MARGIN = 1.15
"""How much more than the motion the camera sees."""


class Surroundings:
    """Colliders, camera and light, which depend on where the motion goes: worked out in the model's space, written in
    that of the file."""

    def __init__(self, stage: Usd.Stage, colliders: Colliders, space: Space, fps: float):
        self._stage = stage
        self._colliders = colliders
        self._space = space
        self._fps = fps
        self._frames = 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def include(self, extent: Vt.Vec3fArray) -> None:
        """The motion goes here too; as the file has it."""
        self._frames += 1
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
        for number in range(len(c)):
            path = f"/World/Colliders/{c.title(number)}_{number}"
            gprim = self._plane(path, number, centre, size) if c.kind[number] == PLANE else self._solid(path, number)
            extent = UsdGeom.Boundable.ComputeExtentFromPlugins(UsdGeom.Boundable(gprim), Usd.TimeCode.Default())
            gprim.CreateExtentAttr(extent)
            gprim.CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set([Gf.Vec3f(*COLLIDER_COLOUR)])

    def _plane(self, path: str, number: int, centre: np.ndarray, size: float) -> UsdGeom.Gprim:
        """The part of an infinite plane that lies nearest to the motion."""
        point, normal = self._colliders.centre[number], self._colliders.size[number]
        gprim = UsdGeom.Plane.Define(self._stage, path)
        gprim.CreateAxisAttr(UsdGeom.Tokens.z)
        gprim.CreateWidthAttr(self._space.length(size))
        gprim.CreateLengthAttr(self._space.length(size))
        foot = centre - normal * ((centre - point) @ normal)
        gprim.AddTranslateOp().Set(Gf.Vec3d(*self._space(foot)))
        rotation = Gf.Rotation(Gf.Vec3d.ZAxis(), Gf.Vec3d(*self._space.turn(normal)))
        gprim.AddOrientOp().Set(Gf.Quatf(rotation.GetQuat()))
        return gprim

    def _solid(self, path: str, number: int) -> UsdGeom.Gprim:
        """What lies in a frame of its own, turned along with the file's axes; at each frame so far, if it moves."""
        c, length = self._colliders, self._space.length
        kind, form = c.kind[number], c.size[number]
        gprim: Any
        if kind == SPHERE:
            gprim = UsdGeom.Sphere.Define(self._stage, path)
            gprim.CreateRadiusAttr(float(length(form[0])))
        elif kind == BOX:
            gprim = UsdGeom.Cube.Define(self._stage, path)
            gprim.CreateSizeAttr(1.0)
        elif kind == CAPSULE:
            gprim = UsdGeom.Capsule.Define(self._stage, path)
            gprim.CreateRadiusAttr(float(length(form[0])))
            gprim.CreateHeightAttr(float(length(2.0 * form[1])))
        elif kind == CONE and form[0] == form[1]:
            gprim = UsdGeom.Cylinder.Define(self._stage, path)
            gprim.CreateRadiusAttr(float(length(form[0])))
            gprim.CreateHeightAttr(float(length(2.0 * form[2])))
        else:
            gprim = UsdGeom.Mesh.Define(self._stage, path)
            points, triangles = c.mesh(number) if kind == MESH else tessellated(int(kind), form)
            gprim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(length(points).astype(np.float32)))
            gprim.CreateFaceVertexCountsAttr(Vt.IntArray([3] * len(triangles)))
            gprim.CreateFaceVertexIndicesAttr(Vt.IntArray(triangles.ravel().tolist()))
            gprim.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        if kind in (CAPSULE, CONE) and not isinstance(gprim, UsdGeom.Mesh):
            gprim.CreateAxisAttr(UsdGeom.Tokens.y)
        translate, orient = gprim.AddTranslateOp(), gprim.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
        if kind == BOX:
            gprim.AddScaleOp().Set(Gf.Vec3f(*length(2.0 * form).tolist()))
        moves = np.any(c.velocity[number]) or np.any(c.spin[number])
        for frame in range(self._frames) if moves else [None]:
            time = 0.0 if frame is None else frame / self._fps
            code = Usd.TimeCode.Default() if frame is None else Usd.TimeCode(frame)
            place = c.centre[number] + time * c.velocity[number]
            turn = after(quaternion(time * c.spin[number]), c.rotation[number])
            if self._space.up_axis == UsdGeom.Tokens.z:
                turn = after(quaternion(np.array([0.5 * np.pi, 0.0, 0.0])), turn)
            translate.Set(Gf.Vec3d(*self._space(place).tolist()), code)
            orient.Set(Gf.Quatd(float(turn[3]), *turn[:3].tolist()), code)
        return gprim

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
