"""What can go wrong: what it was, where, what helps, and what is kept; a sentence, or a line each on a terminal."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class PbdError(Exception):
    """Base of all errors that this package raises on purpose. As text it is all of it in one sentence.

    Args:
        what: What went wrong.
        where: With what settings, at which constraint: goes on where `what` ends.
        remedy: What helps.
        kept: What is left of the work that was done.
    """

    def __init__(self, what: object, *, where: str = "", remedy: str = "", kept: str = ""):
        self.what, self.where, self.remedy, self.kept = str(what), where, remedy, kept
        finding = f"{self.what} {where}" if where else self.what
        super().__init__("; ".join(part for part in (finding, remedy, kept) if part))

    def keeping(self, kept: str) -> PbdError:
        """The same error, which also says what is kept; nothing new where `kept` is empty."""
        return type(self)(self.what, where=self.where, remedy=self.remedy, kept=kept or self.kept)

    @property
    def lines(self) -> list[str]:
        """What it was, and then a line for each of the others that there is something to say of."""
        others = {"where": self.where.removeprefix("with "), "helps": self.remedy, "kept": self.kept}
        return [self.what, *(f"{name}: {text}" for name, text in others.items() if text)]


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
