"""Values as they come from a page, each of the type that is wanted, or an InputError that names it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from pbd_warp import check
from pbd_warp.errors import InputError, unknown


def number(name: str, value: Any, low: float = -1e300, high: float = 1e300) -> float:
    """A number that is written as one: neither a text nor true or false."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{name} must be a number")
    return check.number(name, value, low=low, high=high)


def vector(name: str, values: Any, limit: float) -> tuple[float, float, float]:
    """Three numbers, none beyond a limit."""
    if not isinstance(values, list) or len(values) != 3:
        raise InputError(f"{name} must be 3 numbers")
    x, y, z = (number(name, value, -limit, limit) for value in values)
    return x, y, z


def whole(name: str, value: Any) -> int:
    """A number of things, 0 or more."""
    return check.whole(name, value, low=0)


def up_to(most: int) -> Callable[[str, Any], int]:
    """1 or more, and no more than that."""

    def parse(name: str, value: Any) -> int:
        if check.whole(name, value, low=1) > most:
            raise InputError(f"{name} must be at most {most} in a live view, not {value}")
        return int(value)

    return parse


def fraction(name: str, value: Any) -> float:
    return number(name, value, 0.0, 1.0)


def boolean(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{name} must be true or false")
    return value


def text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise InputError(f"{name} must be a text")
    return value


def one_of(known: tuple[str, ...]) -> Callable[[str, Any], str]:
    """One of some names."""

    def parse(name: str, value: Any) -> str:
        if value not in list(known):
            raise unknown(name, value, known)
        return str(value)

    return parse
