"""Many frames as one USD layer, with memory for a few of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

from pxr import Sdf

Frame = tuple[float, list[Any]]
"""A time code and one value for each of some attributes."""

ELEMENTS_AT_ONCE = 1 << 20
"""Array elements after which a binary layer is saved. What is not saved yet is in memory; but each save appends the
tables of all samples so far anew, so saving each frame of a small model would make its file many times as large."""

FRAMES_AT_ONCE = 32
"""So many frames of one attribute are in memory as text."""


def declare(layer: Sdf.Layer, types: Mapping[Sdf.Path, Sdf.ValueTypeName]) -> Sdf.Layer:
    """The layer, in which these attributes now are."""
    for path, type_name in types.items():
        if not layer.GetAttributeAtPath(path):
            Sdf.AttributeSpec(Sdf.CreatePrimInLayer(layer, path.GetPrimPath()), path.name, type_name)
    return layer


def write_binary(
    file: Path,
    static: Sdf.Layer,
    paths: Sequence[Sdf.Path],
    frames: Iterable[Frame],
    on_save: Callable[[], object] = lambda: None,
) -> None:
    """A .usdc (or .usd) file of `static` and the frames; `on_save` is called whenever a part of it is saved."""
    layer = Sdf.Layer.CreateNew(str(file))
    layer.TransferContent(static)
    pending = 0
    for time, values in frames:
        for path, value in zip(paths, values, strict=True):
            layer.SetTimeSample(path, time, value)
            pending += len(value)
        if pending >= ELEMENTS_AT_ONCE:
            layer.Save()
            on_save()
            pending = 0
    layer.Save()


def write_text(
    file: Path,
    static: Sdf.Layer,
    types: dict[Sdf.Path, Sdf.ValueTypeName],
    frames_of: Callable[[Sequence[Sdf.Path]], Iterator[Frame]],
) -> None:
    """A .usda file of `static` and the frames of the attributes, the same as USD itself would write.

    USD would need all frames in one layer, and for that in memory: in a binary one each page that was read stays. So
    it writes the samples of 32 frames at a time, and they are put where one sample marks the place in `static`.
    """
    marked = Sdf.Layer.CreateAnonymous(".usda")
    marked.TransferContent(static)
    places = {}
    for number, (path, type_name) in enumerate(types.items()):
        mark = (-1e300 * (1.0 + number / 1024), type_name.defaultValue)  # no frame has this time
        marked.SetTimeSample(path, *mark)
        places[_sample_text(path, type_name, [mark])] = path
    with file.open("w", encoding="utf-8", newline="\n") as out:
        for line in marked.ExportToString().splitlines(keepends=True):
            if line not in places:
                out.write(line)
                continue
            path = places[line]
            samples = ((time, value) for time, (value,) in frames_of([path]))
            while batch := list(islice(samples, FRAMES_AT_ONCE)):
                out.write(_sample_text(path, types[path], batch))


def _sample_text(path: Sdf.Path, type_name: Sdf.ValueTypeName, samples: Iterable[tuple[float, Any]]) -> str:
    """The lines that time samples of an attribute are in a text layer."""
    layer = declare(Sdf.Layer.CreateAnonymous(".usda"), {path: type_name})
    for time, value in samples:
        layer.SetTimeSample(path, time, value)
    text = layer.ExportToString()
    opening = re.search(r"^( *).*\.timeSamples = {\n", text, re.MULTILINE)
    assert opening
    return text[opening.end() : text.rindex(f"\n{opening[1]}}}\n") + 1]
