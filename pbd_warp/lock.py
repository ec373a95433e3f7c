"""Locks: what one process writes, no other writes at the same time."""

from __future__ import annotations

import contextlib
from pathlib import Path
from types import TracebackType

from filelock import FileLock, Timeout

from pbd_warp.atomic import Place, through_links
from pbd_warp.errors import InputError


class Lock:
    """Reserves a file, which need not exist, until it is released or the process ends, killed or not.

    It is a file `.NAME.lock` beside that file. One that a killed process has left locks nothing.

    Raises:
        InputError: another has it, or the folder does not take one.
    """

    def __init__(self, path: Path):
        path = through_links(path)
        self._file = path.with_name(f".{path.name}.lock")
        self._place = Place(path.parent)
        # Not of one thread: whoever drops it last releases it.
        self._lock = FileLock(self._file, thread_local=False)
        try:
            self._lock.acquire(blocking=False)
        except Timeout:
            raise InputError(f"another run is writing to {path}: wait for it, or name another file") from None
        except OSError as error:
            raise InputError(f"{self._file}, which reserves {path}, cannot be made: {error.strerror}") from None

    def release(self) -> None:
        if self._lock.is_locked:
            if self._place.there:
                # While it is held: whoever opened it before finds that it has no name any more, and tries again.
                with contextlib.suppress(OSError):  # Windows removes it only after that
                    self._file.unlink()
            self._lock.release(force=True)

    def __enter__(self) -> Lock:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.release()

    def __del__(self) -> None:
        if hasattr(self, "_lock"):
            self.release()
