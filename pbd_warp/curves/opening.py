"""Opens the stage of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pxr import Tf, Usd, UsdGeom, UsdUtils

from pbd_warp import check
from pbd_warp.errors import InputError

EXTENSIONS = (".usda", ".usdc", ".usd", ".usdz")


def open_stage(path: Path) -> Usd.Stage:
    """The stage of a file, with all payloads.

    Raises:
        InputError: no file, no USD, or something that it is composed of is missing.
    """
    if path.suffix not in EXTENSIONS:
        raise InputError(f"{path} must end in one of {', '.join(EXTENSIONS)}, not in {path.suffix or 'nothing'!r}")
    if not path.is_file():
        raise InputError(f"there is no file {path}")
    said = UsdUtils.CoalescingDiagnosticDelegate()  # its warnings come back as one sentence of ours
    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException:
        raise InputError(f"{path} cannot be read as USD: is it complete, and does its ending say what it is?") from None
    finally:
        warnings = [_words(diagnostic) for diagnostic in said.TakeUncoalescedDiagnostics()]
    if stage.GetCompositionErrors():
        reason = warnings[0].split(" (instantiating")[0] if warnings else str(stage.GetCompositionErrors()[0])
        raise InputError(f"{path} is not complete: {reason.rstrip('.')}")
    check.number(f"metersPerUnit of {path}", UsdGeom.GetStageMetersPerUnit(stage), above=0.0)
    return stage


def _words(diagnostic: Any) -> str:
    try:
        return diagnostic.commentary
    except UnicodeDecodeError:
        return "it names something that is no text, as damaged files do"
