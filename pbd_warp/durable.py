"""Files that are whole or not there, whatever happens while they are written."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from pxr import Tf

from pbd_warp.errors import InputError, SimulationFailed

try:
    import fcntl
except ImportError:  # Windows: two runs to one path are then not noticed
    fcntl = None  # type: ignore[assignment]


@contextlib.contextmanager
def replacing(path: Path, temporary: Path) -> Iterator[Path]:
    """Write to `temporary` (same file system) in the body; then it is on the disk and takes the place of `path`.

    Raises:
        SimulationFailed: it could not be written. `path` is as it was, `temporary` gone.
    """
    try:
        yield temporary
        _sync(temporary)
        os.replace(temporary, path)
        _sync(path.parent)
    except (OSError, Tf.ErrorException) as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise SimulationFailed(f"{path} could not be written: {reason(error)}; is the disk full?") from error


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


def _sync(path: Path) -> None:
    if path.is_dir() and os.name == "nt":
        return  # Windows opens no folders
    descriptor = os.open(path, os.O_RDONLY if path.is_dir() else os.O_RDWR)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def reason(error: Exception) -> str:
    """USD's errors are many lines of where in its source; the first one's words are the reason."""
    if isinstance(error, Tf.ErrorException) and error.args:
        return str(getattr(error.args[0], "commentary", error))
    return str(error)
