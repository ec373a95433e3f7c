"""One HTML file that plays a motion: the live view's own drawing, the frames inside, nothing from any network."""

from __future__ import annotations

import base64
import gzip
import html
import json
import re
from importlib.resources import files
from typing import Any

import numpy as np

MODULES = (
    ("camera", "pbd_warp.view", "camera.js"),
    ("draw", "pbd_warp.view", "draw.js"),
    ("player", "pbd_warp.player", "player.js"),
)
"""In the order in which they are run: name, package, file in its folder page/."""

_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:class|function|const) (\w+))", re.MULTILINE)


def page(scene: dict[str, Any], x: np.ndarray, fps: float, title: str, stretch_from: str) -> str:
    """The page as text.

    Args:
        scene: What is drawn, see `Drawn.around`.
        x: [m], [frame_count, particle_count, 3].
    """
    frames = np.ascontiguousarray(x, dtype="<f4").tobytes()
    about = {**scene, "title": title, "fps": fps, "frames": len(x), "stretch_from": stretch_from}
    parts = {
        "TITLE": html.escape(title),
        "STYLE": _read("pbd_warp.player", "player.css"),
        "SCENE": json.dumps(about).replace("<", "\\u003c"),
        # Compressed without a time in it: the same motion is the same file.
        "FRAMES": base64.b64encode(gzip.compress(frames, 6, mtime=0)).decode("ascii"),
        "SCRIPT": _bundle(),
    }
    template = _read("pbd_warp.player", "player.html")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def inline(text: str) -> str:
    """A page as a frame within another, such as a notebook."""
    look = "width:100%;height:420px;border:0;border-radius:8px"
    return f'<iframe srcdoc="{html.escape(text)}" style="{look}" allow="fullscreen"></iframe>'


def _bundle() -> str:
    """All modules as one script: each is a function that gives what it exports, so that their names keep apart."""
    script = []
    for name, package, file in MODULES:
        source = _read(package, file)
        exported = _EXPORT.findall(source)
        source = _IMPORT.sub(r"const \1 = module_\2;", _EXPORT.sub("", source))
        script.append(f"const module_{name} = (() => {{\n{source}\nreturn {{ {', '.join(exported)} }};\n}})();\n")
    return "".join(script)


def _read(package: str, file: str) -> str:
    return (files(package) / "page" / file).read_text(encoding="utf-8")
