"""Files that are whole or not there, whatever happens while they are written."""

from __future__ import annotations

import contextlib
import os
import re
import secrets
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from pbd_warp.errors import SimulationFailed


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
                raise not_written(path, error) from error


@contextlib.contextmanager
def replacing(path: Path, temporary: Path | None = None, late: LateSync | None = None) -> Iterator[Path]:
    """Write to the path that this gives; after the body that file takes the place of `path`, through links.

    Before that it is brought to the disk, with `late` after that.

    Args:
        temporary: Where to write, on the same file system; a hidden name beside `path` unless given.

    Raises:
        SimulationFailed: it could not be written. `path` is as it was, what was written of the new one is gone.
    """
    path = through_links(path)
    temporary = temporary or hidden(path)
    try:
        yield temporary
        if late is None:
            _sync_all([_open(temporary)])
        os.replace(temporary, path)
        if late is None:
            _sync_all([_open(path.parent)])
        else:
            late.add(path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError):
            raise not_written(path, error) from error
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file, whole or not at all (SimulationFailed)."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")


def through_links(path: Path) -> Path:
    """The file that is written where `path` is: what it leads to, where it is a link."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def hidden(path: Path) -> Path:
    """A name beside `path` that nothing has, of the same kind, for a file that is to replace it."""
    return path.with_name(f".{path.stem}.{secrets.token_hex(4)}.new{path.suffix}")


def clear_hidden(path: Path) -> None:
    """Remove what killed processes left of `hidden` files; only while no other process writes to `path`."""
    # Or six letters in place of the suffix: USD, too, writes to another name first.
    ours = re.compile(rf"\.{re.escape(path.stem)}\.[0-9a-f]{{8}}\.new({re.escape(path.suffix)}|\.\w{{6}})")
    for file in path.parent.iterdir():
        if ours.fullmatch(file.name):
            with contextlib.suppress(OSError):
                file.unlink()


class Place:
    """A folder that has to stay where it is while files are written to it.

    A library that makes folders as it needs them would go on writing where one has been moved away.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._is = _inode(folder)

    @property
    def there(self) -> bool:
        """Whether it still is the folder that it was."""
        return self._is is not None and _inode(self.folder) == self._is

    def check(self) -> None:
        """Raise a SimulationFailed where it is not."""
        if not self.there:
            raise SimulationFailed(
                f"the folder {self.folder} was moved or removed during the run: what was written went with it"
            )


def not_written(path: Path, error: OSError) -> SimulationFailed:
    """The sentence on a file that could not be written."""
    return SimulationFailed(f"{path} could not be written: {error}; is the disk full?")


def _inode(folder: Path) -> tuple[int, int] | None:
    try:
        status = folder.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


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
