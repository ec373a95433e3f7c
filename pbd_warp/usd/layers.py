"""Layers on disk: their frames, and whose they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pxr import Sdf, Tf

from pbd_warp.errors import InputError
from pbd_warp.identity import Identity
from pbd_warp.usd.errors import reason
from pbd_warp.usd.merge import Frame

Types = Mapping[Sdf.Path, Sdf.ValueTypeName]
"""The attributes that are animated, by path."""

RUN = "run"
"""The key in customLayerData under which a file says whose it is."""


def open_layer(file: Path) -> Sdf.Layer:
    """Not through USD's registry of layers, which might give an older one of that name."""
    if not file.is_file():
        raise OSError(f"there is no {file}")
    return Sdf.Layer.OpenAsAnonymous(str(file))


def frames_of(layer: Sdf.Layer, paths: Sequence[Sdf.Path], repeats: bool = False) -> Iterator[Frame]:
    """A layer's frames, without the first where that repeats another chunk's last."""
    for time in layer.ListTimeSamplesForPath(paths[0])[1 if repeats else 0 :]:
        yield time, [layer.QueryTimeSample(path, time) for path in paths]


def common_times(layer: Sdf.Layer, types: Types) -> list[float]:
    """The first time codes, as many as all attributes have alike."""
    columns = [layer.ListTimeSamplesForPath(path) for path in types]
    rows = zip(*columns, strict=False)
    times = []
    for row in rows:
        if len(set(row)) > 1:
            break
        times.append(row[0])
    return times


def mark(layer: Sdf.Layer, identity: Identity | None) -> None:
    """Write into a layer whose it is."""
    if identity is not None:
        layer.customLayerData = {**layer.customLayerData, RUN: identity.to_json()}


def check_identity(layer: Sdf.Layer, identity: Identity | None, where: Path) -> None:
    """Raise an InputError where a layer is of another run."""
    if identity is not None:
        identity.refuse_other(layer.customLayerData.get(RUN), where)


def open_root(file: Path) -> Sdf.Layer:
    """A stage's layer as it is on disk now, or an InputError."""
    try:
        return open_layer(file)
    except (Tf.ErrorException, OSError) as error:
        raise InputError(f"{file} cannot be gone on from: {reason(error)}") from None
