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

PACKAGES = ("pbd_warp.player", "pbd_warp.drawing")
"""Whose folders page/ modules are looked for in: what draws is the same as in the live view."""

_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:class|function|const) (\w+))", re.MULTILINE)


def page(
    scene: dict[str, Any], x: np.ndarray, fps: float, title: str, stretch_from: str, tension: np.ndarray | None = None
) -> str:
    """The page as text.

    Args:
        scene: What is drawn, see `Drawn.around`.
        x: [m], [frame_count, particle_count, 3].
        tension: [N], [frame_count, link_count].
    """
    about = {**scene, "title": title, "fps": fps, "frames": len(x), "stretch_from": stretch_from}
    about["has_tension"] = tension is not None and tension.size > 0
    parts = {
        "TITLE": html.escape(title),
        "STYLE": _read("player.css"),
        "SCENE": json.dumps(about).replace("<", "\\u003c"),
        "FRAMES": _packed(x),
        "TENSION": _packed(np.zeros(0) if tension is None else tension),
        "SCRIPT": _bundle(),
    }
    template = _read("player.html")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def inline(text: str) -> str:
    """A page as a frame within another, such as a notebook."""
    look = "width:100%;height:420px;border:0;border-radius:8px"
    return f'<iframe srcdoc="{html.escape(text)}" style="{look}" allow="fullscreen"></iframe>'


def _packed(values: np.ndarray) -> str:
    """Float32, compressed without a time in it: the same motion is the same file."""
    raw = np.ascontiguousarray(values, dtype="<f4").tobytes()
    return base64.b64encode(gzip.compress(raw, 6, mtime=0)).decode("ascii")


def _bundle(first: str = "player") -> str:
    """A module and all that it imports as one script, what is imported before what imports it: each is a function that
    gives what it exports, so that their names keep apart."""
    written: dict[str, str] = {}

    def write(name: str) -> None:
        source = _read(f"{name}.js")
        for _, wanted in _IMPORT.findall(source):
            if wanted not in written:
                write(wanted)
        exported = _EXPORT.findall(source)
        source = _IMPORT.sub(r"const \1 = module_\2;", _EXPORT.sub("", source))
        written[name] = f"const module_{name} = (() => {{\n{source}\nreturn {{ {', '.join(exported)} }};\n}})();\n"

    write(first)
    return "".join(written.values())


def _read(file: str) -> str:
    found = [files(package) / "page" / file for package in PACKAGES]
    return next(path for path in found if path.is_file()).read_text(encoding="utf-8")
