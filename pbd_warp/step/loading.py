"""Loading kernels, and telling who waits what is being compiled: the first time it takes seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import warp as wp

from pbd_warp.kernel_cache import load_module

listeners: list[Callable[[str | None], object]] = []
"""Each is called with what is loaded, and with None at the end; from the thread that loads."""


def load_modules(names: Iterable[str], device: wp.Device) -> None:
    """Load Warp modules, compiling those that are not in Warp's cache."""
    names = sorted(names)
    for number, name in enumerate(names, 1):
        plain = name.removeprefix("pbd_warp.kernels.").replace(".", ", ")
        for tell in listeners:
            tell(f"{plain} ({number} of {len(names)})")
        load_module(name, device)
    for tell in listeners:
        tell(None)
