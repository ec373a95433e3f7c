"""A USD animation that grows by frames, outlives a kill at any moment and ends as one file."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

from pxr import Sdf, Tf, Usd, Vt

from pbd_warp.atomic import FolderLock, LateSync, reason, replacing
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.usd.merge import Frame, declare, write_binary, write_text

CHUNK = 32
"""Frames a chunk: at most so many are lost when the process is killed."""


class Animation:
    """A USD file that grows by frames and survives being killed at any moment.

    While it grows, the frames lie beside the file asked for: every 32 of them become a layer (a chunk) in the folder
    `STEM.partial.EXT.frames`, and `STEM.partial.EXT` is a stage that shows all chunks as value clips. Files are only
    ever replaced as a whole, so that stage opens whatever happens and holds every frame up to the last finished chunk.
    `close` merges them into the one file under its name and removes them. What is shorter than a chunk is held in
    memory and written once. An unfinished file never takes the place of a finished one, but that of another
    unfinished one.

    Args:
        path: The file asked for, see `pbd_warp.usd.writer.check_path`.
        stage: In memory, with all that does not change with time. It may be edited until `close`; its sublayers and
            references stay what they are.
        attributes: Those of `stage` that get one time sample a frame; arrays.
        resume: Go on after so many frames of what lies on disk: the unfinished, interrupted or finished file,
            whichever is the latest. Frames beyond are dropped.
        before_saving: Called whenever the stage is about to be written: the time to edit what depends on the motion.

    Attributes:
        frames: Written so far, resumed ones included.
        saved: The path written in the end, None until then.

    Raises:
        InputError: another process is writing to the path, or there are fewer frames on disk than `resume`.
    """

    def __init__(
        self,
        path: Path,
        stage: Usd.Stage,
        attributes: Sequence[Usd.Attribute],
        resume: int | None = None,
        before_saving: Callable[[], object] = lambda: None,
    ):
        self.frames = 0
        self.saved: Path | None = None
        self._path = path
        self._root = path.with_name(f"{path.stem}.partial{path.suffix}")
        self._folder = path.with_name(f"{self._root.name}.frames")
        self._lock: FolderLock | None = None  # from the first chunk on
        self._stage = stage
        self._types = {attribute.GetPath(): attribute.GetTypeName() for attribute in attributes}
        self._before_saving = before_saving
        self._shown_from: list[float] = []  # one time code a chunk, the one that is being filled included
        self._full = 0  # chunks, all on disk
        self._chunk = self._new_chunk()
        self._times: list[float] = []  # its frames
        self._last: float | None = None
        self._kept = 0  # frames that a kill leaves
        self._late = LateSync()
        if self._folder.is_dir():
            FolderLock(self._folder).release()
        if resume:
            self._resume(resume)

    def write(self, values: Sequence[Any], time_code: float) -> None:
        """Add a frame: one Vt array an attribute, at a later time code than the frame before.

        Raises:
            SimulationFailed: a chunk could not be written. The chunks before it still open.
        """
        if len(self._times) == CHUNK:
            self._end_chunk()  # as the disk was full the first time
        self._add(values, float(time_code))
        if len(self._times) == CHUNK:
            self._end_chunk()

    def flush(self) -> None:
        """Make what was written so far survive a kill, and a machine that loses power.

        Raises:
            SimulationFailed: it could not be written.
        """
        self._save()
        self._late.finish()

    def values(self, attribute: Usd.Attribute) -> Iterator[Any]:
        """What was written of an attribute so far, frame by frame, read from disk where it is there."""
        for _, (value,) in self._recorded([attribute.GetPath()]):
            yield value

    def close(self) -> None:
        """Make the one file under its name.

        Raises:
            SimulationFailed: it could not be written. The chunks stay where they are, and the error says where.
        """
        self._finish(self._path, None)

    def discard(self) -> None:
        """Give up what was written, as if it had never begun."""
        if self._lock is not None:
            self._root.unlink(missing_ok=True)
            shutil.rmtree(self._folder, ignore_errors=True)
            self._lock.release()

    def __enter__(self) -> Animation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """After an exception the frames so far become one file: under the name asked for, if nothing stands there."""
        if error is None:
            self.close()
        elif self.frames:
            self._finish(self._root if self._path.exists() else self._path, error)

    # Chunks.

    def _new_chunk(self) -> Sdf.Layer:
        return declare(Sdf.Layer.CreateAnonymous(".usdc"), self._types)

    def _add(self, values: Sequence[Any], time: float) -> None:
        if self._last is not None and time <= self._last:
            raise InputError(f"time code {time:g} is not later than {self._last:g}, that of the frame before")
        for path, value in zip(self._types, values, strict=True):
            self._chunk.SetTimeSample(path, time, value)
        if not self._times:
            self._shown_from.append(time if self._last is None else self._last)
        self._times.append(time)
        self._last = time
        self.frames += 1

    def _end_chunk(self) -> None:
        self._save()
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        """The full one is done with. The next repeats its last frame: between the two the motion goes on evenly."""
        chunk = self._new_chunk()
        for path in self._types:
            chunk.SetTimeSample(path, self._last, self._chunk.QueryTimeSample(path, self._last))
        self._chunk, self._times, self._full = chunk, [], self._full + 1

    def _file(self, number: int) -> Path:
        return self._folder / f"{number:06}.usdc"

    def _save(self) -> None:
        if self._kept < self.frames:
            self._take_place()
            self._write_chunk()
            self._write_root()

    def _write_chunk(self) -> None:
        with replacing(self._file(self._full), self._folder / "new.usdc", self._late) as temporary:
            self._chunk.Export(str(temporary))

    def _recorded(self, paths: Sequence[Sdf.Path]) -> Iterator[Frame]:
        yield from _frames(map(_open, map(self._file, range(self._full))), paths)
        for time in self._times:
            yield time, [self._chunk.QueryTimeSample(path, time) for path in paths]

    # The unfinished stage.

    def _take_place(self) -> None:
        """Make the folder, in place of what an unfinished run left."""
        if self._lock is not None:
            return
        left = self._folder.is_dir()
        try:
            self._lock_folder()
            if left:
                self._root.unlink(missing_ok=True)
                for file in self._folder.iterdir():
                    file.unlink()
        except (InputError, OSError) as error:
            raise SimulationFailed(f"{self._folder} could not be written: {error}") from error

    def _lock_folder(self) -> None:
        self._folder.mkdir(exist_ok=True)
        self._lock = FolderLock(self._folder)

    def _static(self) -> Sdf.Layer:
        """All that does not change with time."""
        self._before_saving()
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.TransferContent(self._stage.GetRootLayer())
        declare(layer, self._types)
        if self._shown_from:  # a stage may know a longer range
            first, last = self._shown_from[0], self._last
            layer.startTimeCode = min(layer.startTimeCode, first) if layer.HasStartTimeCode() else first
            layer.endTimeCode = max(layer.endTimeCode, last) if layer.HasEndTimeCode() else last
        return layer

    def _write_root(self) -> None:
        layer = self._static()
        files = [f"./{self._folder.name}/{self._file(number).name}" for number in range(len(self._shown_from))]
        clips = {
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(file) for file in files]),
            "manifestAssetPath": Sdf.AssetPath(files[0]),  # which attributes there are
            "active": Vt.Vec2dArray([(time, number) for number, time in enumerate(self._shown_from)]),
        }
        for prim in dict.fromkeys(path.GetPrefixes()[0] for path in self._types):
            layer.GetPrimAtPath(prim).SetInfo("clips", {"default": {**clips, "primPath": str(prim)}})
        with replacing(self._root, self._folder / f"new{self._root.suffix}", self._late) as temporary:
            layer.Export(str(temporary))
        self._kept = self.frames

    # The end, and going on.

    def _finish(self, path: Path, after: BaseException | None) -> None:
        """Merge everything into one file; `after` is the error that ended the run, if one did."""
        try:
            if path == self._root and self._folder.is_dir():
                self._take_place()  # an unfinished run's, maybe
            if self._lock is not None:
                self.flush()
            # The suffix decides the format, so the temporary name keeps it.
            hidden = path.with_name(f".{self._path.stem}.{os.getpid()}{path.suffix}")
            with replacing(path, self._folder / f"merged{path.suffix}" if self._lock else hidden) as temporary:
                self._merge(temporary)
            self.saved = path
            if self._lock is not None:
                if path != self._root:
                    self._root.unlink(missing_ok=True)
                shutil.rmtree(self._folder, ignore_errors=True)
        except SimulationFailed as failure:
            kept = f"; the first {self._kept} frames are in {self._root}" if self._kept else ""
            told = after if isinstance(after, SimulationFailed) else failure
            raise SimulationFailed(f"{told}{kept}") from (after or failure)
        finally:
            if self._lock is not None:
                self._lock.release()

    def _merge(self, file: Path) -> None:
        paths = list(self._types)
        static = self._static()
        if self._full == 0:
            for time, values in self._recorded(paths):
                for path, value in zip(paths, values, strict=True):
                    static.SetTimeSample(path, time, value)
            static.Export(str(file))
        elif file.suffix == ".usda":
            write_text(file, static, self._types, self._recorded)
        else:
            write_binary(file, static, paths, self._recorded(paths), lambda: self._late.add(file))
            self._late.finish()

    def _resume(self, count: int) -> None:
        left = [path for path in (self._root, self._path) if path.exists()]
        if not left:
            raise InputError(f"there are no frames to go on from: neither {self._root} nor {self._path} exists")
        source = max(left, key=lambda path: path.stat().st_mtime_ns)
        try:
            layer = Sdf.Layer.FindOrOpen(str(source))
            layer.Reload()  # this process may have opened an older one
            files = self._chunks_of(layer)
            last = _open(files[-1]) if files else layer
            whole = CHUNK * max(len(files) - 1, 0)
            there = whole + min(len(_own_times(last, whole, path)) for path in self._types)
            if there < count:
                raise InputError(f"{source} holds {there} frames, fewer than the {count} to go on from")
            if source == self._root:
                self._lock_folder()
            else:
                self._take_place()
            for time, values in islice(_frames(map(_open, files) if files else [layer], list(self._types)), count):
                self._add(values, time)
                if len(self._times) == CHUNK:
                    if not files:
                        self._write_chunk()
                    self._begin_chunk()
        except Tf.ErrorException as error:
            raise InputError(f"{source} cannot be gone on from: {reason(error)}") from error
        # Only now is what was there given up, as all of it that counts is in the chunks.
        if self._times:
            self._write_chunk()
        self._write_root()
        for file in self._folder.iterdir():
            if file.name > self._file(len(self._shown_from) - 1).name:
                file.unlink()

    def _chunks_of(self, layer: Sdf.Layer) -> list[Path]:
        """The files of an unfinished stage; none of a finished one."""
        prim = layer.GetPrimAtPath(next(iter(self._types)).GetPrefixes()[0])
        clips = prim.GetInfo("clips") if prim else None
        return [self._file(number) for number in range(len(clips["default"]["assetPaths"]))] if clips else []


def _open(file: Path) -> Sdf.Layer:
    """Not through USD's registry of layers, which might give an older one of that name."""
    return Sdf.Layer.OpenAsAnonymous(str(file))


def _own_times(chunk: Sdf.Layer, before: int, path: Sdf.Path) -> list[float]:
    """The time codes of a chunk's frames, without the one that it repeats if there are chunks before."""
    return chunk.ListTimeSamplesForPath(path)[1 if before else 0 :]


def _frames(chunks: Iterable[Sdf.Layer], paths: Sequence[Sdf.Path]) -> Iterator[Frame]:
    for number, chunk in enumerate(chunks):
        for time in _own_times(chunk, number, paths[0]):
            yield time, [chunk.QueryTimeSample(path, time) for path in paths]
