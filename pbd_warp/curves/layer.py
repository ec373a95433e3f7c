"""The layer that a simulation adds over a stage."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from pxr import Ar, Sdf, Usd, UsdGeom

from pbd_warp.curves.scene import StageScene

ATTRIBUTES = {
    "points": Sdf.ValueTypeNames.Point3fArray,
    "velocities": Sdf.ValueTypeNames.Vector3fArray,
    "extent": Sdf.ValueTypeNames.Float3Array,
}


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
    if source.stage.GetRootLayer().defaultPrim:
        layer.defaultPrim = source.stage.GetRootLayer().defaultPrim
    layer.customLayerData = dict(metadata)
    _describe(stage, source)
    return stage


def flattened(source: StageScene, metadata: Mapping[str, str | int | float]) -> Usd.Stage:
    """The whole input as one layer in memory, without what the simulation replaces."""
    layer = source.stage.Flatten(addSourceFileComment=False)
    layer.customLayerData = {**layer.customLayerData, **metadata}
    stage = Usd.Stage.Open(layer)
    _describe(stage, source)
    for curves in source.curves:
        for name in ATTRIBUTES:
            stage.GetPrimAtPath(curves.path).RemoveProperty(name)
    return stage


def animated_attributes(stage: Usd.Stage, source: StageScene) -> list[Usd.Attribute]:
    """What gets a value a frame: points, velocities and extent of each prim, one prim after the other."""
    attributes = []
    for curves in source.curves:
        prim = stage.OverridePrim(curves.path)
        attributes += [prim.CreateAttribute(name, kind, False) for name, kind in ATTRIBUTES.items()]
        _block_what_is_no_longer_true(stage, source.stage.GetPrimAtPath(curves.path))
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
    stale = [UsdGeom.PointBased(prim).GetAccelerationsAttr()]
    while prim and not prim.IsPseudoRoot():
        stale.append(UsdGeom.ModelAPI(prim).GetExtentsHintAttr())
        prim = prim.GetParent()
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
