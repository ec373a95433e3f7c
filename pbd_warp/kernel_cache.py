"""Warp's cache of compiled kernels: what is damaged in it is made again."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import warp as wp

from pbd_warp.errors import InputError, SimulationFailed

try:
    import fcntl
except ImportError:  # Windows: processes that start together compile each for itself
    fcntl = None  # type: ignore[assignment]


def begin() -> None:
    """Start Warp, which makes the folder of the cache.

    Raises:
        InputError: it cannot be made.
    """
    try:
        wp.init()
    except OSError as error:
        raise InputError(
            f"Warp's kernel cache cannot be made: {error}; set WARP_CACHE_PATH to another folder"
        ) from None


def load_module(name: str, device: wp.Device) -> None:
    """Load a module of kernels, compiled if need be; what the cache has of it is made again if it does not load.

    Of many processes that start together one compiles, and the others find it in the cache.

    Raises:
        SimulationFailed: it does not load even so.
    """
    with _alone():
        _load(name, device)


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """No other process of this machine is in here; the lock ends with the process, however that ends."""
    with contextlib.ExitStack() as held:
        with contextlib.suppress(OSError):  # a cache that cannot be written to, a file system without locks
            lock = held.enter_context(open(Path(wp.config.kernel_cache_dir) / ".pbd-warp-compiles", "w"))
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _load(name: str, device: wp.Device) -> None:
    with contextlib.suppress(Exception):  # Warp has no exceptions of its own, and JSON and the file system theirs
        wp.load_module(name, device=device)
        return
    cache = Path(wp.config.kernel_cache_dir)
    for folder in cache.glob(f"wp_{name}_*"):
        shutil.rmtree(folder, ignore_errors=True)
    try:
        wp.load_module(name, device=device)
    except Exception as error:
        raise SimulationFailed(
            f"kernels do not compile into Warp's cache {cache}, or load from there: {error}; "
            "set WARP_CACHE_PATH to a folder with room that can be written to"
        ) from error
