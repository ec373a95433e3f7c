"""The frames of an animation that is not finished, in a folder: layers of 32 frames each, the last one in memory."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pxr import Sdf, Tf, Vt

from pbd_warp.atomic import LateSync, Place, replacing
from pbd_warp.errors import InputError
from pbd_warp.identity import Identity
from pbd_warp.usd.errors import as_os_error
from pbd_warp.usd.layers import Types, check_identity, common_times, frames_of, mark, open_layer
from pbd_warp.usd.merge import Frame, declare

CHUNK = 32
"""Frames a chunk: at most so many are lost when the process is killed."""

OURS = re.compile(r"\d{6,}\.usdc|(new|merged)\.(usd[ac]?|\w{6})")
"""Names of our files in the folder, and of those that USD writes to on the way; others are somebody's own."""


class Chunks:
    """The files of a folder, `000000.usdc` and so on, and the chunk that is being filled.

    A chunk repeats the last frame of the one before it, so that between the two the motion goes on evenly.

    Args:
        folder: Where they are; made by `begin`.
        types: Their attributes.
        identity: Of the run; each chunk carries it.

    Attributes:
        late: Brings them to the disk.
        frames: How many there are in all.
        shown_from: The time code from which each chunk is to be seen, the one that is being filled included.
        last: The time code of the last frame.
        full: Chunks that are done with, all on disk.
    """

    def __init__(self, folder: Path, types: Types, identity: Identity | None):
        self.folder = folder
        self.late = LateSync()
        self.frames = 0
        self.shown_from: list[float] = []
        self.last: float | None = None
        self.full = 0
        self._types = types
        self._identity = identity
        self._place: Place | None = None
        self._chunk = self._new()
        self._times: list[float] = []  # of its frames

    def add(self, values: Sequence[Any], time: float) -> None:
        """A frame: one value an attribute."""
        if self.last is not None and time <= self.last:
            raise InputError(f"time code {time:g} is not later than {self.last:g}, that of the frame before")
        for path, value in zip(self._types, values, strict=True):
            self._chunk.SetTimeSample(path, time, value)
        if not self._times:
            self.shown_from.append(time if self.last is None else self.last)
        self._times.append(time)
        self.last = time
        self.frames += 1

    @property
    def is_full(self) -> bool:
        """The chunk that is being filled."""
        return len(self._times) == CHUNK

    def begin_next(self) -> None:
        """The full one, which has been written, is done with."""
        full, self._chunk, self._times = self._chunk, self._new(), []
        for path in self._types:
            self._chunk.SetTimeSample(path, self.last, full.QueryTimeSample(path, self.last))
        self.full += 1

    def recorded(self, paths: Sequence[Sdf.Path]) -> Iterator[Frame]:
        """All frames, read from disk where they are there."""
        for number in range(self.full):
            yield from frames_of(open_layer(self._file(number)), paths, bool(number))
        for time in self._times:
            yield time, [self._chunk.QueryTimeSample(path, time) for path in paths]

    # On disk.

    def begin(self) -> None:
        """Make the folder."""
        self.folder.mkdir(exist_ok=True)
        self._place = Place(self.folder)

    @property
    def begun(self) -> bool:
        """Whether the folder is ours."""
        return self._place is not None

    @property
    def there(self) -> bool:
        """Whether the folder is where it was made."""
        return self._place is not None and self._place.there

    def write(self) -> None:
        """Write the chunk that is being filled, if there is anything in it."""
        if self._times:
            self.export(self._chunk, self._file(self.full))

    def export(self, layer: Sdf.Layer, path: Path) -> None:
        """Put a layer under its name, whole, by way of a file in the folder."""
        assert self._place is not None
        self._place.check()
        with replacing(path, self.folder / f"new{path.suffix}", self.late) as temporary:
            with as_os_error():
                layer.Export(str(temporary))
            self._place.check()  # USD makes a folder that is not there

    def remove(self, first: int = 0) -> None:
        """Delete the chunks from a number on; with all of them goes the folder, if it holds nothing else."""
        keep = {self._file(number).name for number in range(first)}
        for file in self.folder.iterdir():
            if OURS.fullmatch(file.name) and file.name not in keep:
                file.unlink()
        if not first:
            with contextlib.suppress(OSError):
                self.folder.rmdir()

    def show(self, root: Sdf.Layer) -> Sdf.Layer:
        """Make a layer show the chunks as value clips."""
        files = [f"./{self.folder.name}/{self._file(number).name}" for number in range(len(self.shown_from))]
        clips = {
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(file) for file in files]),
            "manifestAssetPath": Sdf.AssetPath(files[0]),  # which attributes there are
            "active": Vt.Vec2dArray([(time, number) for number, time in enumerate(self.shown_from)]),
        }
        for prim in dict.fromkeys(path.GetPrefixes()[0] for path in self._types):
            root.GetPrimAtPath(prim).SetInfo("clips", {"default": {**clips, "primPath": str(prim)}})
        return root

    # Going on.

    def shown_by(self, root: Sdf.Layer) -> int:
        """How many chunks a stage shows; 0 where it holds its frames itself."""
        prim = root.GetPrimAtPath(next(iter(self._types)).GetPrefixes()[0])
        clips = prim.GetInfo("clips") if prim else None
        return len(clips["default"]["assetPaths"]) if clips else 0

    def times_on_disk(self, count: int) -> list[list[float]]:
        """Time codes of the frames in the first so many chunks, up to one that is missing, damaged, short, of another
        run, or does not go on from the one before."""
        times: list[list[float]] = []
        for number in range(count):
            try:
                layer = open_layer(self._file(number))
                check_identity(layer, self._identity, self._file(number))
                own = common_times(layer, self._types)
            except (Tf.ErrorException, InputError, OSError):
                break
            if number:
                if len(times[-1]) < CHUNK or own[:1] != times[-1][-1:]:
                    break
                own = own[1:]
            if not own:
                break
            times.append(own)
        return times

    def adopt(self, times: list[list[float]], count: int) -> None:
        """Begin with the first `count` frames of what is on disk; `times` as `times_on_disk` gives them."""
        self.begin()
        full, partial = divmod(count, CHUNK)
        needed = times[: full + bool(partial)]
        self.shown_from = [needed[0][0], *(chunk[-1] for chunk in needed[:-1])]
        self.frames, self.last, self.full = count, needed[-1][(count - 1) % CHUNK], len(needed) - 1
        self._times = needed[-1][: partial or CHUNK]
        layer = open_layer(self._file(self.full))
        for time in layer.ListTimeSamplesForPath(next(iter(self._types))):
            if time <= self.last:
                for path in self._types:
                    self._chunk.SetTimeSample(path, time, layer.QueryTimeSample(path, time))

    def _file(self, number: int) -> Path:
        return self.folder / f"{number:06}.usdc"

    def _new(self) -> Sdf.Layer:
        layer = declare(Sdf.Layer.CreateAnonymous(".usdc"), self._types)
        mark(layer, self._identity)
        return layer
