"""Whose a file is: what makes the frames of a run, as a few digests that its files carry."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pbd_warp.errors import InputError
from pbd_warp.model.flat import flat_arrays
from pbd_warp.model.model import Model
from pbd_warp.settings import Settings


@dataclass(frozen=True)
class Identity:
    """Digests of what a run is made of; frames of runs that have the same may be put together.

    model: Its particles, constraints and colliders, and the precision. settings: How it is simulated. drags: What
    moves its particles. stage: The files that the model is read from, and how the frames are written.
    """

    model: str
    settings: str
    drags: str
    stage: str

    @classmethod
    def of(cls, model: Model, settings: Settings, drags: Any, stage: str = "") -> Identity:
        """Of a run; `drags` is anything that JSON can hold."""
        arrays = hashlib.sha256(model.dtype.encode())
        for name, values in flat_arrays(model):
            arrays.update(f"{name} {values.dtype} {values.shape}".encode())
            arrays.update(values.tobytes())
        return cls(_short(arrays), digest(settings.to_json()), digest(drags), stage)

    def to_json(self) -> dict[str, str]:
        return asdict(self)

    def refuse_other(
        self, theirs: Any, where: str | Path, parts: Iterable[str] = ("model", "settings", "drags", "stage")
    ) -> None:
        """Raise an InputError where a file carries another identity (as `to_json` has it) or none."""
        if not isinstance(theirs, Mapping):
            raise InputError(f"{where} does not say which run it is of: start from the beginning")
        others = [name for name in parts if theirs.get(name) != getattr(self, name)]
        if others:
            raise InputError(
                f"{where} is of another run, as it differs in {' and '.join(others)}: start from the beginning"
            )


def digest(value: Any) -> str:
    """Of something that JSON can hold."""
    return _short(hashlib.sha256(json.dumps(value, sort_keys=True).encode()))


def digest_of_files(files: Iterable[Path], said: Any) -> str:
    """Of the contents of files, in any order, and of what was said about how to read them."""
    contents = []
    for file in files:
        content = hashlib.sha256()
        with open(file, "rb") as opened:
            while block := opened.read(1 << 20):
                content.update(block)
        contents.append(_short(content))
    return digest([sorted(contents), said])


def _short(made: Any) -> str:
    return made.hexdigest()[:16]
