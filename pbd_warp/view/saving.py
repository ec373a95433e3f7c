"""What a page can save: the frames that are kept, as a USD file, or what was done, for `run --drags`."""

from __future__ import annotations

import tempfile
from pathlib import Path

from pbd_warp.grab.recording import Recording
from pbd_warp.view.history import Clip

SAVED = {
    "clip.usda": "application/octet-stream",
    "clip.usdc": "application/octet-stream",
    "drags.json": "application/json",
}
"""Types by the name under which it is asked for."""


def saved_file(name: str, clip: Clip, drags: Recording) -> tuple[str, bytes]:
    """A file by the name under which it is asked for: its own name, plain enough for a header, and its bytes.

    Raises:
        SimulationFailed: it could not be written.
    """
    scene = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "_" for c in clip.name)
    if name == "drags.json":
        return f"{scene}.drags.json", drags.to_text().encode()
    file = scene + Path(name).suffix
    with tempfile.TemporaryDirectory() as folder:
        clip.write(Path(folder) / file)
        return file, (Path(folder) / file).read_bytes()
