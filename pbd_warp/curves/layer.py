"""The layer that a simulation adds over a stage."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from pxr import Ar, Sdf, Usd, UsdGeom

from pbd_warp.curves.attributes import check_types
from pbd_warp.curves.scene import StageScene
from pbd_warp.curves.skinning import unbind
from pbd_warp.errors import InputError
from pbd_warp.usd.tension import PRIMVAR, define_tension

ATTRIBUTES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
    "tangents": Sdf.ValueTypeNames.Vector3fArray,
}

OF_THE_FILE = ("subLayers", "subLayerOffsets", "primChildren", "layerRelocates", "documentation", "comment", "owner")
"""What a layer says of itself; the rest of its metadata is about the stage, and USD reads it of the root layer only."""


def layer_files(stage: Usd.Stage) -> list[Path]:
    """The files that a stage is read from."""
    paths = [Ar.SplitPackageRelativePathOuter(layer.realPath)[0] for layer in stage.GetUsedLayers()]
    return [Path(path) for path in dict.fromkeys(paths) if path and Path(path).is_file()]


def override_layer(source: StageScene, out: Path, metadata: Mapping[str, str | int | float]) -> Usd.Stage:
    """A stage in memory, to be saved as `out`, that has the input as its sublayer and nothing else yet."""
    stage = Usd.Stage.CreateInMemory()
    layer = stage.GetRootLayer()
    path = _relative(source.path, out.parent)
    stage.MuteLayer(path)  # it is not to be found from memory, only from where the file will be
    layer.subLayerPaths.append(path)
    read = source.stage.GetRootLayer()
    for key in read.pseudoRoot.ListInfoKeys():
        if key in OF_THE_FILE:
            continue
        value = read.pseudoRoot.GetInfo(key)
        if isinstance(value, Sdf.AssetPath) and value.path.startswith("."):
            value = Sdf.AssetPath(_relative(Path(read.ComputeAbsolutePath(value.path)), out.parent))
        layer.pseudoRoot.SetInfo(key, value)
    layer.customLayerData = {**layer.customLayerData, **metadata}
    _describe(stage, source)
    return stage


def flattened(source: StageScene, metadata: Mapping[str, str | int | float], tension: bool = False) -> Usd.Stage:
    """The whole input as one layer in memory, without what the simulation replaces; tension: of those too.

    Raises:
        InputError: an attribute anywhere of another type than it should have, which would not open again.
    """
    for prim in source.stage.TraverseAll():
        try:
            check_types(prim)
        except InputError as error:
            raise InputError(f"the stage cannot be flattened: {error}") from None
    layer = source.stage.Flatten(addSourceFileComment=False)
    layer.customLayerData = {**layer.customLayerData, **metadata}
    stage = Usd.Stage.Open(layer)
    _describe(stage, source)
    for curves in source.curves:
        for name in (*curves.attributes, *((PRIMVAR, f"{PRIMVAR}:indices") if tension else ())):
            stage.GetPrimAtPath(curves.path).RemoveProperty(name)
    return stage


def animated_attributes(stage: Usd.Stage, source: StageScene, tension: bool = False) -> list[Usd.Attribute]:
    """What gets a value a frame: the attributes of each prim, with its tensions last, one prim after the other."""
    attributes = []
    for curves in source.curves:
        prim = stage.OverridePrim(curves.path)
        attributes += [prim.CreateAttribute(name, ATTRIBUTES[name], False) for name in curves.attributes]
        if tension:
            attributes.append(define_tension(prim))
        _block_what_is_no_longer_true(stage, curves.prim)
        if curves.skinning:
            unbind(stage, curves.path)
    return attributes


def _describe(stage: Usd.Stage, source: StageScene) -> None:
    """The input's own units, axis and time, so that the output opens alike on its own."""
    read, time = source.stage, source.timeline
    UsdGeom.SetStageUpAxis(stage, UsdGeom.GetStageUpAxis(read))
    UsdGeom.SetStageMetersPerUnit(stage, UsdGeom.GetStageMetersPerUnit(read))
    stage.SetTimeCodesPerSecond(read.GetTimeCodesPerSecond())
    stage.SetFramesPerSecond(read.GetFramesPerSecond())
    last = time.time_code(time.frames - 1)
    stage.SetStartTimeCode(time.start)
    stage.SetEndTimeCode(max(last, read.GetEndTimeCode()) if read.HasAuthoredTimeCodeRange() else last)


def _block_what_is_no_longer_true(stage: Usd.Stage, prim: Usd.Prim) -> None:
    """Accelerations of the curves, and extents that ancestors keep of everything below them."""
    stale = [UsdGeom.PointBased(prim).GetAccelerationsAttr(), UsdGeom.ModelAPI(prim).GetExtentsHintAttr()]
    while (prim := prim.GetParent()) and not prim.IsPseudoRoot():
        stale += [UsdGeom.ModelAPI(prim).GetExtentsHintAttr(), UsdGeom.Boundable(prim).GetExtentAttr()]
    for attribute in stale:
        if attribute and attribute.HasAuthoredValue():
            over = stage.OverridePrim(attribute.GetPrimPath())
            over.CreateAttribute(attribute.GetName(), attribute.GetTypeName(), False).Block()


def _relative(path: Path, folder: Path) -> str:
    """A path from a folder, marked as such for USD; the whole path where there is none (another drive)."""
    try:
        relative = Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return path.resolve().as_posix()
    return relative if relative.startswith("../") else f"./{relative}"
