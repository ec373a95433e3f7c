"""A stage as a scene: its curves as ropes, its geometry as colliders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from pxr import Tf, Usd

from pbd_warp import check
from pbd_warp.curves.colliders import StageCollider
from pbd_warp.curves.curves import Curves
from pbd_warp.curves.material import Material
from pbd_warp.curves.opening import open_stage
from pbd_warp.curves.physics import gravity_of, up_axis
from pbd_warp.curves.ropes import add_ropes, leave_what_has_no_length
from pbd_warp.curves.selection import find_colliders, find_curves, shared_with_others, without_own_points
from pbd_warp.curves.skinning import Skeletons, moved_by_others
from pbd_warp.curves.timeline import Timeline, timeline
from pbd_warp.errors import InputError, unknown
from pbd_warp.model.builder import DTYPES, ModelBuilder, find_device
from pbd_warp.scene import Scene
from pbd_warp.step.methods import Direct
from pbd_warp.usd.errors import reason

SUBSTEPS = 16
"""With which `Direct` keeps a hair at 24 frames a second from losing its swing."""


@dataclass(frozen=True)
class StageScene:
    """What a stage has to simulate.

    scene: The ropes and colliders, particles in the order of `curves`, and the settings to simulate them. Others come
        from `changed`; frames and fps are the timeline's.
    colliders: What the curves collide with.
    gravity: [m/s^2], shape [3].
    origin: Of the simulation in world space [m]: positions in float32 are finest near it.
    left: What is not simulated and stays as it is, in a sentence each with the reason.
    notes: What else is unusual, in a sentence each.
    """

    path: Path
    stage: Usd.Stage
    timeline: Timeline
    curves: list[Curves]
    colliders: list[StageCollider]
    gravity: np.ndarray
    origin: np.ndarray
    scene: Scene
    device: wp.Device
    dtype: str
    left: list[str]
    notes: list[str]

    def changed(self, **changes: Any) -> StageScene:
        """The same curves simulated with other settings, by name."""
        return replace(self, scene=self.scene.changed(**changes))

    def without(self, reasons: dict[str, dict[int, str]]) -> StageScene:
        """What is left to simulate without some curves, which stay as they are.

        Args:
            reasons: By path of the prim, and number of the curve.

        Raises:
            InputError: nothing is left.
        """
        curves, left = [], []
        for each in self.curves:
            try:
                each.leave(reasons.get(each.path, {}))
                curves.append(each)
            except InputError as error:
                left.append(f"{each.path} is left as it is: {error}")
        if not curves:
            raise InputError(left[0])
        builder = ModelBuilder(self.gravity)
        add_ropes(builder, curves, self.origin, self.device, self.dtype)
        for collider in self.colliders:
            collider.add(builder, self.origin)
        return replace(self, curves=curves, scene=self.scene.changed(builder=builder), left=[*self.left, *left])


def load_stage(
    path: Path,
    prims: Sequence[str] = (),
    collide: Sequence[str] = (),
    material: Material | None = None,
    gravity: float | None = None,
    frames: int | None = None,
    fps: float | None = None,
    device: Any = None,
    dtype: str = "float32",
    skip: Sequence[str] = (),
    strict: bool = False,
) -> StageScene:
    """Read what there is to simulate.

    Args:
        prims: Patterns of the paths of curves; all unless given. skip: Patterns of those to leave out.
        collide: Patterns of the paths of geometry to collide with; "physics": all that has UsdPhysics.CollisionAPI.
        material: What all ropes are made of; where it says nothing, what their prims say.
        gravity: Against the stage's up axis [m/s^2]; what the stage's physics scene says unless given.
        frames, fps: As in `timeline`.
        strict: Refuse a stage with curves that cannot be simulated, instead of leaving them as they are; and fail where
            Newton's method leaves something over, instead of noting it.

    Raises:
        InputError: what cannot be read, makes no sense or is not modelled, and nothing is left to simulate.
    """
    if dtype not in DTYPES:
        raise unknown("dtype", dtype, DTYPES)
    where = find_device(device)
    stage = open_stage(path)
    time = timeline(stage, frames, fps)
    codes = time.time_codes
    pull, note = (
        gravity_of(stage, codes) if gravity is None else (-check.number("gravity", gravity) * up_axis(stage), "")
    )
    chosen = find_curves(stage, prims, skip)
    curves, reasons = _read_curves(stage, chosen, codes, material or Material())
    origin = np.concatenate([each.x for each in curves]).mean(axis=0) if curves else np.zeros(3)
    curves = _without(curves, reasons, leave_what_has_no_length(curves, origin, where, dtype))
    while curves and (shared := shared_with_others(stage, [each.path for each in curves])):
        curves = _without(curves, reasons, shared)
    left = [f"{name} is left as it is: {reason}" for name, reason in reasons.items()]
    left += [_some_left(each) for each in curves if each.left]
    left += [f"{each.path}: {text}" for each in curves for text in each.notes]
    if not curves:
        raise InputError(next(f"{name}: {reason}" for name, reason in reasons.items()))
    if left and strict:
        raise InputError(left[0])
    colliders = [StageCollider.of(prim, codes) for prim in find_colliders(stage, collide)]
    scene = Scene(
        ModelBuilder(pull),
        time.frames,
        fps=time.fps,
        name=path.stem,
        method=Direct(),
        substeps=SUBSTEPS,
        on_failure="raise" if strict else "continue",
    )
    notes = [text for text in (time.note, note) if text]
    notes += [f"{each.path}: {text}" for each in curves if (text := moved_by_others(each.prim))]
    source = StageScene(path, stage, time, curves, colliders, pull, origin, scene, where, dtype, left, notes)
    return source.without({})


def _read_curves(
    stage: Usd.Stage, chosen: Sequence[Usd.Prim], time_codes: np.ndarray, material: Material
) -> tuple[list[Curves], dict[str, str]]:
    """The prims that can be simulated, and why the others cannot, by path."""
    skeletons = Skeletons()
    curves, reasons = [], without_own_points(stage, chosen)
    for prim in chosen:
        path = str(prim.GetPath())
        if path in reasons:
            continue
        try:
            curves.append(Curves(prim, time_codes, material.of(prim, time_codes), skeletons.skinning(prim)))
        except InputError as error:
            reasons[path] = str(error)
        except (Tf.ErrorException, UnicodeDecodeError) as error:
            reasons[path] = f"USD cannot read it: {reason(error)}"
    return curves, reasons


def _without(curves: list[Curves], reasons: dict[str, str], more: dict[str, str]) -> list[Curves]:
    """The curves without those that there are more reasons to leave, which are noted."""
    reasons |= more
    return [each for each in curves if each.path not in more]


def _some_left(curves: Curves) -> str:
    """One sentence on the curves of a prim that are left as they are."""
    first = min(curves.left)
    what = f"{len(curves.left)} of its {len(curves.kind.counts)} curves are left as they are, the first of them curve"
    if len(curves.left) == 1:
        return f"{curves.path}: curve {first} is left as it is: {curves.left[first]}"
    return f"{curves.path}: {what} {first}: {curves.left[first]}"
