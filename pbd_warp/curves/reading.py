"""Opens stages and finds prims in them."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdUtils

from pbd_warp import check
from pbd_warp.errors import InputError

EXTENSIONS = (".usda", ".usdc", ".usd", ".usdz")

SECONDS = 5.0
"""Simulated where neither the stage nor the user says how long."""


def open_stage(path: Path) -> Usd.Stage:
    """The stage of a file.

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
        warnings = [diagnostic.commentary for diagnostic in said.TakeUncoalescedDiagnostics()]
    if stage.GetCompositionErrors():
        reason = warnings[0].split(" (instantiating")[0] if warnings else str(stage.GetCompositionErrors()[0])
        raise InputError(f"{path} is not complete: {reason.rstrip('.')}")
    check.number(f"metersPerUnit of {path}", UsdGeom.GetStageMetersPerUnit(stage), above=0.0)
    return stage


def matches(path: str, pattern: str) -> bool:
    """Whether a prim or one of its ancestors has a path that matches the pattern (* ? [])."""
    parts = path.split("/")
    return any(fnmatch.fnmatchcase("/".join(parts[:end]), pattern) for end in range(2, len(parts) + 1))


def find_curves(stage: Usd.Stage, patterns: Sequence[str]) -> list[Usd.Prim]:
    """The BasisCurves of a stage that match one of the patterns; all without patterns.

    Raises:
        InputError: none are there, a pattern matches none, or some are instances.
    """
    every = [prim for prim in _prims(stage) if prim.IsA(UsdGeom.BasisCurves)]
    if not every:
        raise InputError("the stage has no BasisCurves: there is nothing to simulate")
    for pattern in patterns:
        if not any(matches(_path(prim), pattern) for prim in every):
            some = ", ".join(_path(prim) for prim in every[:5]) + (", ..." if len(every) > 5 else "")
            raise InputError(f"--prim {pattern} matches no BasisCurves: there is {some}")
    chosen = [p for p in every if not patterns or any(matches(_path(p), pattern) for pattern in patterns)]
    prototypes = _prototypes(stage)
    for prim in chosen:
        if prim.IsInstanceProxy():
            raise InputError(
                f"{_path(prim)} is part of an instance, which cannot have points of its own: set instanceable = false, "
                "or leave it out with --prim"
            )
        if any(prim.GetPath().HasPrefix(prototype) for prototype in prototypes):
            raise InputError(
                f"{_path(prim)} is a prototype of a PointInstancer, whose copies cannot move each by itself: "
                "leave it out with --prim"
            )
    return chosen


def find_colliders(stage: Usd.Stage, patterns: Sequence[str]) -> list[Usd.Prim]:
    """The geometry that matches one of the patterns."""
    every = [prim for prim in _prims(stage) if prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer)]
    for pattern in patterns:
        if not any(matches(_path(prim), pattern) for prim in every):
            raise InputError(f"--collide {pattern} matches no geometry: give the path of a Plane or Sphere")
    return [prim for prim in every if any(matches(_path(prim), pattern) for pattern in patterns)]


def _prims(stage: Usd.Stage) -> Iterator[Usd.Prim]:
    return iter(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))


def _path(prim: Usd.Prim) -> str:
    return str(prim.GetPath())


def _prototypes(stage: Usd.Stage) -> list:
    instancers = [UsdGeom.PointInstancer(prim) for prim in _prims(stage) if prim.IsA(UsdGeom.PointInstancer)]
    return [target for instancer in instancers for target in instancer.GetPrototypesRel().GetForwardedTargets()]


MOST_FRAMES = 1_000_000
"""Four and a half hours at 60 a second: a longer range is a mistake of whoever wrote the stage."""


@dataclass(frozen=True)
class Timeline:
    """The frames: their number, how many there are a second, and the time codes of the stage at which they are."""

    frames: int
    fps: float
    start: float
    time_codes_per_second: float

    def time_code(self, frame: int) -> float:
        if self.fps == self.time_codes_per_second:
            return self.start + frame  # which n * 23.976 / 23.976 is not always
        return self.start + frame * self.time_codes_per_second / self.fps

    @property
    def time_codes(self) -> np.ndarray:
        """Of all frames, shape [frames]."""
        return np.array([self.time_code(frame) for frame in range(self.frames)])


def timeline(stage: Usd.Stage, frames: int | None = None, fps: float | None = None) -> Timeline:
    """A frame at every time code of the stage's range, from the first on; without a range, SECONDS from time code 0.

    Args:
        frames: How many instead. fps: How many a second instead of timeCodesPerSecond.
    """
    codes = check.number("timeCodesPerSecond", stage.GetTimeCodesPerSecond(), above=0.0)
    rate = codes if fps is None else check.number("fps", fps, above=0.0)
    start = end = 0.0
    if stage.HasAuthoredTimeCodeRange():
        start = check.number("startTimeCode", stage.GetStartTimeCode())
        end = check.number("endTimeCode", stage.GetEndTimeCode(), low=start)
    if frames is None:
        # A range ends on a frame; rounding must not lose it.
        seconds = (end - start) / codes if stage.HasAuthoredTimeCodeRange() else SECONDS
        frames = int(np.floor(seconds * rate + 1e-6)) + 1
    frames = check.whole("frames", frames, low=1)
    if frames > MOST_FRAMES:
        raise InputError(f"{frames} frames are more than {MOST_FRAMES}: give the number of them with --frames")
    return Timeline(frames, rate, start, codes)


class Placement:
    """Where a prim is: its local space in world space, in metres.

    Row vectors: world = local @ linear + offset.

    Raises:
        InputError: at one of the frames it is flattened to less than space, so nothing can be brought back into it.
    """

    def __init__(self, prim: Usd.Prim, time_codes: np.ndarray):
        self._prim = prim
        self._unit = UsdGeom.GetStageMetersPerUnit(prim.GetStage())
        self._start = self._read(float(time_codes[0]))
        up = prim
        self.animated = False
        while up and not up.IsPseudoRoot():
            xform = UsdGeom.Xformable(up)
            self.animated |= bool(xform) and xform.TransformMightBeTimeVarying()
            up = up.GetParent()
        for time_code in time_codes if self.animated else time_codes[:1]:
            linear, offset = self.at(float(time_code))
            scale = np.linalg.norm(linear, axis=1).prod()
            flat = not np.isfinite(linear).all() or abs(np.linalg.det(linear)) <= 1e-9 * scale or scale == 0.0
            if flat or not np.isfinite(offset).all():
                raise InputError(
                    f"{_path(prim)} has a transform that cannot be inverted at time code {time_code:g}: "
                    "give it a scale above 0 in all axes"
                )

    def at(self, time_code: float) -> tuple[np.ndarray, np.ndarray]:
        """linear [3, 3], offset [3], in metres."""
        return self._read(time_code) if self.animated else self._start

    def _read(self, time_code: float) -> tuple[np.ndarray, np.ndarray]:
        matrix = UsdGeom.Imageable(self._prim).ComputeLocalToWorldTransform(time_code)
        matrix = np.array(matrix) * self._unit
        return matrix[:3, :3], matrix[3, :3]
