"""A USD animation that grows by frames, outlives a kill at any moment and ends as one file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import Any

from pxr import Sdf, Tf, Usd

from pbd_warp.atomic import Place, clear_hidden, hidden, replacing, through_links
from pbd_warp.errors import InputError, SimulationFailed
from pbd_warp.identity import Identity
from pbd_warp.lock import Lock
from pbd_warp.paths import chunk_folder, unfinished
from pbd_warp.usd.chunks import Chunks
from pbd_warp.usd.errors import as_os_error, reason
from pbd_warp.usd.layers import check_identity, common_times, frames_of, mark, open_root
from pbd_warp.usd.merge import declare, write_binary, write_text


class Animation:
    """A USD file that grows by frames and survives being killed at any moment.

    While it grows, the frames lie beside the file asked for: every 32 of them become a layer (a chunk) in the folder
    `STEM.partial.EXT.frames`, and `STEM.partial.EXT` is a stage that shows all chunks as value clips. Files are only
    ever replaced as a whole, so that stage opens whatever happens and holds every frame up to the last finished chunk.
    `close` merges them into the one file under its name and removes them. What is shorter than a chunk is held in
    memory and written once. An unfinished file never takes the place of a finished one, but that of another
    unfinished one.

    Args:
        path: The file asked for, see `pbd_warp.usd.writer.check_path`. It is reserved until the end.
        stage: In memory, with all that does not change with time. It may be edited until `close`; its sublayers and
            references stay what they are.
        attributes: Those of `stage` that get one time sample a frame; arrays.
        resume: Go on after so many frames of what lies on disk: the unfinished or interrupted file, or the finished
            one where that is not of this run or has fewer frames. Frames beyond are dropped.
        before_saving: Called whenever the stage is about to be written: the time to edit what depends on the motion.
        identity: Of the run. All files carry it, and only files with the same are gone on from.

    Attributes:
        saved: The path written in the end, None until then.

    Raises:
        InputError: another process is writing to the path, or no file of this run has as many frames as `resume`.
    """

    def __init__(
        self,
        path: Path,
        stage: Usd.Stage,
        attributes: Sequence[Usd.Attribute],
        resume: int | None = None,
        before_saving: Callable[[], object] = lambda: None,
        identity: Identity | None = None,
    ):
        self.saved: Path | None = None
        self._path = path = through_links(path)
        self._root = unfinished(path)
        self._stage = stage
        self._types = {attribute.GetPath(): attribute.GetTypeName() for attribute in attributes}
        self._before_saving = before_saving
        self._identity = identity
        self._chunks = Chunks(chunk_folder(path), self._types, identity)
        self._kept = 0  # frames that a kill leaves
        self._lock = Lock(path)
        self._place = Place(path.parent)
        try:
            clear_hidden(path)
            if resume:
                self._resume(resume)
        except BaseException:
            self._lock.release()
            raise

    @property
    def frames(self) -> int:
        """Written so far, resumed ones included."""
        return self._chunks.frames

    def write(self, values: Sequence[Any], time_code: float) -> None:
        """Add a frame: one Vt array an attribute, at a later time code than the frame before.

        Raises:
            SimulationFailed: a chunk could not be written. The chunks before it still open.
        """
        if self._chunks.is_full:
            self._end_chunk()  # as the disk was full the first time
        self._chunks.add(values, float(time_code))
        if self._chunks.is_full:
            self._end_chunk()

    def flush(self) -> None:
        """Make what was written so far survive a kill, and a machine that loses power.

        Raises:
            SimulationFailed: it could not be written.
        """
        self._save()
        self._chunks.late.finish()

    def values(self, attribute: Usd.Attribute) -> Iterator[Any]:
        """What was written of an attribute so far, frame by frame, read from disk where it is there."""
        for _, (value,) in self._chunks.recorded([attribute.GetPath()]):
            yield value

    def close(self) -> None:
        """Make the one file under its name.

        Raises:
            SimulationFailed: it could not be written. The chunks stay where they are, and the error says where.
        """
        self._finish(self._path, None)
        self._lock.release()

    def discard(self) -> None:
        """Give up what was written, as if it had never begun."""
        if self._chunks.begun:
            self._root.unlink(missing_ok=True)
            self._chunks.remove()
        self._lock.release()

    def __enter__(self) -> Animation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """After an exception the frames so far become one file: under the name asked for, if nothing stands there."""
        try:
            if error is None:
                self.close()
            elif self.frames:
                self._finish(self._root if self._path.exists() else self._path, error)
        finally:
            self._lock.release()

    # While it grows.

    def _end_chunk(self) -> None:
        self._save()
        self._chunks.begin_next()

    def _save(self) -> None:
        if self._kept < self.frames:
            self._take_place()
            self._chunks.write()
            self._write_root(self._chunks.last)

    def _take_place(self) -> None:
        """Make the folder of chunks, in place of what an unfinished run left."""
        self._place.check()
        if self._chunks.begun:
            return
        try:
            if self._chunks.folder.is_dir():
                self._root.unlink(missing_ok=True)  # first: without it nobody takes chunks for frames
                self._chunks.remove()
            self._chunks.begin()
        except OSError as error:
            raise SimulationFailed(f"{self._chunks.folder} could not be written: {error}") from error

    def _write_root(self, last: float | None) -> None:
        """The unfinished stage, of frames up to a time code."""
        self._chunks.export(self._chunks.show(self._static(last)), self._root)
        self._kept = self.frames

    def _static(self, last: float | None) -> Sdf.Layer:
        """All that does not change with time."""
        self._before_saving()
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.TransferContent(self._stage.GetRootLayer())
        declare(layer, self._types)
        mark(layer, self._identity)
        if self.frames:  # a stage may know a longer range
            first = self._chunks.shown_from[0]
            layer.startTimeCode = min(layer.startTimeCode, first) if layer.HasStartTimeCode() else first
            layer.endTimeCode = max(layer.endTimeCode, last) if layer.HasEndTimeCode() else last
        return layer

    # The end.

    def _finish(self, path: Path, after: BaseException | None) -> None:
        """Merge everything into one file; `after` is the error that ended the run, if one did."""
        try:
            self._place.check()
            if path == self._root and self._chunks.folder.is_dir():
                self._take_place()  # an unfinished run's, maybe
            if self._chunks.begun:
                self.flush()
            # The suffix decides the format, so the temporary name keeps it.
            temporary = self._chunks.folder / f"merged{path.suffix}" if self._chunks.begun else hidden(self._path)
            with replacing(path, temporary), as_os_error():
                self._merge(temporary)
                self._place.check()
            self.saved = path
            if self._chunks.begun:
                if path != self._root:
                    self._root.unlink(missing_ok=True)
                self._chunks.remove()
        except SimulationFailed as failure:
            there = self._kept and self._place.there and self._chunks.there and self._root.exists()
            kept = f"the first {self._kept} frames are in {self._root}" if there else ""
            told = after if isinstance(after, SimulationFailed) else failure
            raise told.keeping(kept) from (after or failure)

    def _merge(self, file: Path) -> None:
        paths, recorded = list(self._types), self._chunks.recorded
        static = self._static(self._chunks.last)
        if self._chunks.full == 0:
            for time, values in recorded(paths):
                for path, value in zip(paths, values, strict=True):
                    static.SetTimeSample(path, time, value)
            static.Export(str(file))
        elif file.suffix == ".usda":
            write_text(file, static, self._types, recorded)
        else:
            write_binary(file, static, paths, recorded(paths), lambda: self._chunks.late.add(file))
            self._chunks.late.finish()

    # Going on.

    def _resume(self, count: int) -> None:
        left = [path for path in (self._root, self._path) if path.exists()]
        if not left:
            raise InputError(f"there are no frames to go on from: neither {self._root} nor {self._path} exists")
        refused = []
        for source in left:
            try:
                layer, times = self._open(source, count)
            except InputError as error:
                refused.append(str(error))
                continue
            try:
                return self._resume_layer(layer, source, count) if times is None else self._resume_chunks(times, count)
            except Tf.ErrorException as error:
                raise InputError(f"{source} cannot be gone on from: {reason(error)}") from error
        raise InputError("; ".join(refused))

    def _open(self, source: Path, count: int) -> tuple[Sdf.Layer, list[list[float]] | None]:
        """What holds at least `count` frames of this run: a layer, and the time codes of its chunks, if it has some."""
        layer = open_root(source)
        check_identity(layer, self._identity, source)
        shown = self._chunks.shown_by(layer)
        times = self._chunks.times_on_disk(shown) if shown else None
        there = len(common_times(layer, self._types)) if times is None else sum(map(len, times))
        if there < count:
            raise InputError(f"{source} holds {there} frames, fewer than the {count} to go on from")
        return layer, times

    def _resume_chunks(self, times: list[list[float]], count: int) -> None:
        """From an unfinished stage. At each moment it shows frames without a gap, and at least `count` of them."""
        self._chunks.adopt(times, count)
        # First the chunks that stay, as they are on disk: no later one may follow one that gets shorter.
        self._write_root(times[len(self._chunks.shown_from) - 1][-1])
        self._chunks.late.finish()
        self._go_on()

    def _resume_layer(self, layer: Sdf.Layer, source: Path, count: int) -> None:
        """From a file that holds its frames itself; it stays what it is until there are chunks of them."""
        if source == self._root:
            self._chunks.begin()
        else:
            self._take_place()
        for time, values in islice(frames_of(layer, list(self._types)), count):
            if self._chunks.is_full:
                self._chunks.write()
                self._chunks.begin_next()
            self._chunks.add(values, time)
        self._go_on()

    def _go_on(self) -> None:
        """Bring what is gone on from to the disk, and drop what is beyond."""
        self._chunks.write()
        self._write_root(self._chunks.last)
        self._chunks.remove(len(self._chunks.shown_from))
        if self._chunks.is_full:
            self._chunks.begin_next()
