"""A USD file that grows by frames."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from pxr import Tf, Usd

from pbd_warp.errors import SimulationFailed


class Animation:
    """A USD file that grows by frames; use it as a context manager.

    Kept in memory until it is closed. The file appears whole or not at all; after an exception the frames so far become
    a valid file too, beside a finished one that stands there already (`<stem>.partial<extension>`).

    Args:
        path: Where to.
        stage: In memory; its root layer holds everything that does not change with time.
        attributes: Those of it that get one time sample a frame, authored in the root layer.

    Attributes:
        frames: Frames written so far.
        saved: The path written in the end, None until then.
    """

    def __init__(self, path: Path, stage: Usd.Stage, attributes: Sequence[Usd.Attribute], resume: int | None = None):
        self._path = path
        self._stage = stage
        self._attributes = list(attributes)
        self.frames = 0
        self.saved: Path | None = None

    def write(self, values: Sequence[Any], time_code: float) -> None:
        """One frame: a Vt array for each of the attributes."""
        for attribute, value in zip(self._attributes, values, strict=True):
            attribute.Set(value, time_code)
        self.frames += 1

    def flush(self) -> None:
        """Nothing is on disk until the end."""

    def close(self) -> None:
        """Complete the file and put it under its name."""
        self._save(self._path)

    def __enter__(self) -> Animation:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        elif self.frames:
            path = self._path
            self._save(path.with_name(f"{path.stem}.partial{path.suffix}") if path.exists() else path)

    def _save(self, path: Path) -> None:
        temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
        try:
            if not self._stage.GetRootLayer().Export(str(temporary)):
                raise OSError("USD could not export the layer")
            os.replace(temporary, path)
        except (OSError, Tf.ErrorException) as error:
            with contextlib.suppress(OSError):
                temporary.unlink()
            raise SimulationFailed(f"{path} could not be written: {error}; is the disk full?") from error
        self.saved = path
