"""Checks of input, shared by everything that takes some. Each raises an InputError that names the thing."""

from __future__ import annotations

import errno
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from pbd_warp.errors import InputError


def number(name: str, value: Any, *, low: float = -math.inf, high: float = math.inf, above: float = -math.inf) -> float:
    """A finite float within [low, high] and > above; text is none, whatever it says."""
    try:
        if isinstance(value, (str, bytes)):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be a number, not {value!r}") from None
    if not math.isfinite(result) or not low <= result <= high or result <= above:
        raise InputError(f"{name} must be {_range(low, high, above)}, not {result:g}")
    return result


def ordinary(path: Path) -> Path:
    """The path of a file to read. Raises an OSError for a device or a pipe, which may never end."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise OSError(errno.EINVAL, "it is not an ordinary file")
    return path


def whole(name: str, value: Any, *, low: int, high: int | None = None) -> int:
    """An integer of at least `low`, and at most `high` where that is given."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)):
        raise InputError(f"{name} must be a whole number, not {value!r}")
    if value < low:
        raise InputError(f"{name} must be at least {low}, not {value}")
    if high is not None and value > high:
        raise InputError(f"{name} must be at most {high}, not {value}")
    return int(value)


def index(name: str, value: Any, count: int) -> int:
    """The number of one of `count` things."""
    value = whole(name, value, low=0)
    if value >= count:
        raise InputError(f"there is no {name} {value}: there are {count}, numbered from 0")
    return value


def vector(name: str, value: Any) -> np.ndarray:
    """Three finite floats, shape [3]."""
    return vectors(name, [value])[0]


def vectors(name: str, values: Any) -> np.ndarray:
    """Finite float64 vectors, shape [n, 3]."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be numbers in threes (x, y, z)") from None
    if array.size == 0:
        array = array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"{name} must have shape [n, 3], not {list(array.shape)}")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if bad.size:
        raise InputError(f"{name} must be finite, but number {bad[0]} is {_text(array[bad[0]])}")
    return array


def spread(name: str, value: Any, count: int, *, low: float = -math.inf, high: float = math.inf) -> np.ndarray:
    """`value` (one number, or one for each of `count`) as float64 [count], each finite and in [low, high]."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be a number or {count} of them, not {value!r}") from None
    if array.ndim > 1 or (array.ndim == 1 and len(array) != count):
        raise InputError(f"{name} must be one number or {count} of them, but has shape {list(array.shape)}")
    array = np.broadcast_to(array, (count,))
    bad = np.flatnonzero(~np.isfinite(array) | (array < low) | (array > high))
    if bad.size:
        where = "" if np.ndim(value) == 0 else f" (number {bad[0]})"
        raise InputError(f"{name} must be {_range(low, high, -math.inf)}, not {array[bad[0]]:g}{where}")
    return array.copy()


def indices(name: str, values: Any, count: int) -> np.ndarray:
    """Particle indices as int32, each in 0..count-1."""
    array = np.asarray(values)
    if array.size == 0:
        return array.astype(np.int32)
    if not np.issubdtype(array.dtype, np.integer):
        raise InputError(f"{name} must be particle indices (whole numbers), not {array.dtype}")
    bad = array[(array < 0) | (array >= count)]
    if bad.size:
        raise InputError(f"{name} names particle {bad.flat[0]}, but there are {count} (0 to {count - 1})")
    return array.astype(np.int32)


def folder(path: Path) -> None:
    """Whether files can be made in a folder, found out by making one (without a name, so that no kill leaves it)."""
    if not path.is_dir():
        raise InputError(f"the output folder {path} does not exist; make it first or name another")
    try:
        with tempfile.TemporaryFile(dir=path):
            pass
    except OSError as error:
        raise InputError(f"the output folder {path} cannot be written to: {error.strerror}") from None


def _range(low: float, high: float, above: float) -> str:
    if low > -math.inf and high < math.inf:
        return f"a finite number in {low:g}..{high:g}"
    if above > -math.inf:
        return f"a finite number above {above:g}"
    if low > -math.inf:
        return f"a finite number of at least {low:g}"
    return "a finite number"


def _text(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{c:g}" for c in vector) + ")"
