"""What can go wrong, in one sentence each: what it was, where, and what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class PbdError(Exception):
    """Base of all errors that this package raises on purpose."""


class InputError(PbdError, ValueError):
    """Bad input, found before anything is simulated or written (exit code 2)."""


class SimulationFailed(PbdError, RuntimeError):
    """The simulation or its output could not go on (exit code 1)."""


class Interrupted(PbdError):
    """The user stopped a run (exit code 130, the shell's for Ctrl-C)."""


def unknown(kind: str, name: object, known: Iterable[str]) -> InputError:
    """The error for a name that is none of the `known` ones, with the nearest of them."""
    names = list(known)
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return InputError(f"unknown {kind} {name!r}: there is {', '.join(names)}{hint}")
