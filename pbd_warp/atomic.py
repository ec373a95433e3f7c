"""Files that are whole or not there, whatever happens while they are written."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from pxr import Tf

from pbd_warp.errors import InputError, SimulationFailed

try:
    import fcntl
except ImportError:  # Windows: two runs to one path are then not noticed
    fcntl = None  # type: ignore[assignment]


class LateSync:
    """Brings files that are in their place to the disk, in a thread, while the caller goes on.

    Until then a process that is killed loses nothing, but a machine that loses power may.
    """

    QUEUE = 8  # files under way; a slow disk holds up who writes faster

    def __init__(self) -> None:
        self._thread: ThreadPoolExecutor | None = None
        self._pending: deque[tuple[Path, Future[None]]] = deque()

    def add(self, path: Path) -> None:
        """Bring this file to the disk, and that its folder has it.

        Raises:
            SimulationFailed: an earlier one did not get there.
        """
        self._wait(self.QUEUE - 1)
        if self._thread is None:
            self._thread = ThreadPoolExecutor(1)
        # Opened now, as another may soon have the name.
        descriptors = [_open(path), _open(path.parent)]
        self._pending.append((path, self._thread.submit(_sync_all, descriptors)))

    def finish(self) -> None:
        """Wait until all are there.

        Raises:
            SimulationFailed: one did not get there.
        """
        self._wait(0)
        if self._thread is not None:
            self._thread.shutdown()
            self._thread = None

    def _wait(self, left: int) -> None:
        while len(self._pending) > left:
            path, result = self._pending.popleft()
            try:
                result.result()
            except OSError as error:
                raise _failed(path, error) from error


@contextlib.contextmanager
def replacing(path: Path, temporary: Path, late: LateSync | None = None) -> Iterator[Path]:
    """Write to `temporary` (same file system) in the body; then it takes the place of `path`.

    Before that it is brought to the disk, with `late` after that.

    Raises:
        SimulationFailed: it could not be written. `path` is as it was, `temporary` gone.
    """
    try:
        yield temporary
        if late is None:
            _sync_all([_open(temporary)])
        os.replace(temporary, path)
        if late is None:
            _sync_all([_open(path.parent)])
        else:
            late.add(path)
    except (OSError, Tf.ErrorException) as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise _failed(path, error) from error


class FolderLock:
    """Reserves a folder until it is released or the process ends, killed or not.

    Raises:
        InputError: another has it.
    """

    def __init__(self, folder: Path):
        self._descriptor: int | None = None
        if fcntl is None:
            return
        self._descriptor = os.open(folder, os.O_RDONLY)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self.release()
            raise InputError(f"another run is writing to {folder}: wait for it, or name another output") from None
        except OSError:
            self.release()  # a file system without locks

    def release(self) -> None:
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def __del__(self) -> None:
        self.release()


def _open(path: Path) -> int | None:
    """A descriptor to sync."""
    if path.is_dir():
        return None if os.name == "nt" else os.open(path, os.O_RDONLY)  # Windows opens no folders
    return os.open(path, os.O_RDWR)


def _sync_all(descriptors: Sequence[int | None]) -> None:
    """Sync these, in this order, and close them."""
    with contextlib.ExitStack() as stack:
        opened = [descriptor for descriptor in descriptors if descriptor is not None]
        for descriptor in opened:
            stack.callback(os.close, descriptor)
        for descriptor in opened:
            os.fsync(descriptor)


def _failed(path: Path, error: Exception) -> SimulationFailed:
    return SimulationFailed(f"{path} could not be written: {reason(error)}; is the disk full?")


def reason(error: Exception) -> str:
    """USD's errors are many lines of where in its source; the first one's words are the reason."""
    if isinstance(error, Tf.ErrorException) and error.args:
        return str(getattr(error.args[0], "commentary", error))
    return str(error)
