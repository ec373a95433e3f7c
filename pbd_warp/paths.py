"""The files that a command reads and writes: that they can be written, and that none of them is another."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from pbd_warp import check
from pbd_warp.atomic import through_links
from pbd_warp.errors import InputError

LONGEST_NAME = 255
"""Bytes; what most file systems take."""


def check_file(path: Path, added: str = "") -> Path:
    """The file to write where a path leads, through links.

    Args:
        added: What is added to its name for files beside it.

    Raises:
        InputError: a name that is no plain text, too long or that of a folder or a device; a folder that is not there
            or cannot be written to.
    """
    try:
        size = len(str(path.name + added).encode()) + len(".xxxxxxxx.new")
    except UnicodeEncodeError:
        raise InputError(f"{str(path)!r} is no name in UTF-8: choose another") from None
    if not str(path).isprintable():
        raise InputError(f"{str(path)!r} has line breaks or other characters that do not print: choose another name")
    if size > LONGEST_NAME:
        raise InputError(f"the name {path.name[:40]}... is too long: choose a shorter one")
    if path.is_dir():
        raise InputError(f"{path} is a folder; name a file in it")
    path = through_links(path)
    if path.exists() and not path.is_file():
        raise InputError(f"{path} is not an ordinary file: name another")
    check.folder(path.parent)
    return path


def unfinished(out: Path) -> Path:
    """The stage that shows an animation while it grows."""
    return out.with_name(f"{out.stem}.partial{out.suffix}")


def chunk_folder(out: Path) -> Path:
    """The folder of its frames until then."""
    return out.with_name(f"{unfinished(out).name}.frames")


def animation_files(out: Path) -> list[Path]:
    """All that writing an animation may touch."""
    return [out, unfinished(out), chunk_folder(out)]


def check_apart(reads: Mapping[str, Iterable[Path]], writes: Mapping[str, Iterable[Path]]) -> None:
    """Raise an InputError where something that is written is, or holds, something that is read or written otherwise.

    The keys say what the files are, in the error. Links and other spellings of a path are followed.
    """
    written = [(what, path) for what, paths in writes.items() for path in paths]
    read = [(what, path) for what, paths in reads.items() for path in paths]
    for number, (what, path) in enumerate(written):
        for other_what, other in read + written[number + 1 :]:
            if what != other_what and (_within(path, other) or _within(other, path)):
                place = other if other == path else f"{other}, which {path} would spoil"
                raise InputError(f"{what} and {other_what} are both {place}: name another file for one of them")


def _within(folder: Path, path: Path) -> bool:
    """Whether a path is the other or lies in it."""
    outer, inner = (os.path.normcase(os.path.realpath(each)) for each in (folder, path))
    if inner == outer or inner.startswith(outer + os.sep):
        return True
    try:  # hard links, and file systems that take small letters for capitals
        return os.path.samefile(folder, path)
    except OSError:
        return False
