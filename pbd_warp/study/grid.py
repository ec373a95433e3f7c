"""The combinations of a study: what is varied, with the values of each, as a grid of rows."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, get_args, get_type_hints

import numpy as np

from pbd_warp.errors import InputError, unknown
from pbd_warp.scene import check_seed, defaults_of, parse_parameters
from pbd_warp.settings import Settings

OF_METHOD = {"method": str, "iterations": int, "tolerance": float}
NOT_VARIED = ("dt", "method", "limits", "capture", "gravity")


def _kinds() -> dict[str, Any]:
    kinds: dict[str, Any] = {**OF_METHOD, "fps": float}
    for name, hint in get_type_hints(Settings).items():
        if name not in NOT_VARIED:
            kinds[name] = next(kind for kind in (int, float, str) if kind in (hint, *get_args(hint)))
    return kinds


SETTINGS = _kinds()
"""Settings that can be varied, and of what type each is."""

OR_A_WORD = [name for name, hint in get_type_hints(Settings).items() if {int, str} <= {*get_args(hint)}]

MOST_ROWS = 1_000_000
"""As many combinations are asked about."""


@dataclass(frozen=True)
class Grid:
    """Every combination of the values of its axes; the last axis varies fastest."""

    axes: dict[str, tuple[Any, ...]]

    def __len__(self) -> int:
        return math.prod(len(values) for values in self.axes.values())

    def __getitem__(self, row: int) -> dict[str, Any]:
        """The values of one combination."""
        at = np.unravel_index(row, [len(values) for values in self.axes.values()]) if self.axes else ()
        return {name: values[int(k)] for (name, values), k in zip(self.axes.items(), at, strict=True)}


def make_grid(name: str, build: Any, axes: Mapping[str, Any], seed: Sequence[int] | None = None) -> Grid:
    """The grid of a scene's parameters, settings and seeds.

    Args:
        name, build: The scene and its function.
        axes: By name, one value or several; numbers, or texts as the command line has them.
        seed: The last axis, for a scene with something random in it.

    Raises:
        InputError: neither a parameter nor a setting, a value of the wrong kind, an axis without values.
    """
    parameters = {key: default for key, default in defaults_of(build).items() if key != "seed"}
    typed: dict[str, tuple[Any, ...]] = {}
    for key, given in axes.items():
        if key not in parameters and key not in SETTINGS:
            raise unknown(f"parameter of scene {name}, or setting,", key, [*parameters, *SETTINGS])
        values = parse_values(given) if isinstance(given, str) else given
        values = list(values) if isinstance(values, (list, tuple, range, np.ndarray)) else [values]
        if key in parameters:
            typed[key] = tuple(parse_parameters(name, build, {key: _text(value)})[key] for value in values)
        else:
            typed[key] = tuple(_setting(key, _text(value)) for value in values)
    if seed is not None:
        seeds = tuple(int(value) for value in seed)
        for value in (min(seeds), max(seeds)) if seeds else ():
            check_seed(name, build, value)
        typed["seed"] = seeds
    for key, values in typed.items():
        if not values:
            raise InputError(f"{key} has no values: nothing is to be done")
        if len(set(values)) < len(values):
            raise InputError(f"{key} has a value twice")
    return Grid(typed)


def parse_values(text: str) -> list[str]:
    """Values of an axis as the command line has them.

    "10,20,50": these. "0..99": whole numbers, both ends included. "0:1:lin11": eleven evenly spaced from 0 to 1;
    "0.1:10:log20": twenty, evenly spaced in ratio.
    """
    if text.count(":") == 2:
        low, high, how = text.split(":")
        try:
            first, last, count = float(low), float(high), int(how[3:])
            if how[:3] not in ("lin", "log") or count < 1 or (how[:3] == "log" and (first <= 0.0 or last <= 0.0)):
                raise ValueError
        except ValueError:
            raise InputError(f"{text!r} must be like 0:1:lin11 or 0.1:10:log20 (of numbers above 0)") from None
        spaced = np.linspace(first, last, count) if how[:3] == "lin" else np.geomspace(first, last, count)
        return [_text(float(f"{value:.12g}")) for value in spaced]
    if ".." in text:
        try:
            low, high = text.split("..")
            return [str(value) for value in range(int(low), int(high) + 1)]
        except ValueError:
            raise InputError(f"{text!r} must be two whole numbers, like 0..99") from None
    return [item.strip() for item in text.split(",") if item.strip()]


def _text(value: Any) -> str:
    """As `parse_parameters` reads it back: 10.0 as 10, so that a whole number stays one."""
    if isinstance(value, (bool, np.bool_)):
        return str(bool(value))
    if isinstance(value, (float, np.floating)):
        return str(int(value)) if float(value).is_integer() and abs(value) < 1e15 else repr(float(value))
    return str(value)


def _setting(name: str, text: str) -> Any:
    kind = SETTINGS[name]
    if kind is int and not text.lstrip("-").isdecimal() and name in OR_A_WORD:
        return text
    try:
        return kind(text)
    except ValueError:
        noun = {int: "a whole number", float: "a number", str: "a text"}[kind]
        raise InputError(f"{name} must be {noun}, not {text!r}") from None
