"""A stage as a scene: its curves as ropes, its planes and spheres as colliders."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from pxr import Usd, UsdGeom

from pbd_warp import check
from pbd_warp.curves.colliders import add_collider
from pbd_warp.curves.curves import Curves
from pbd_warp.curves.material import Material
from pbd_warp.curves.reading import Timeline, find_colliders, find_curves, open_stage, timeline
from pbd_warp.errors import InputError, unknown
from pbd_warp.kernels.distance import measure_distance
from pbd_warp.kernels.precision import PRECISIONS
from pbd_warp.model.builder import DTYPES, ModelBuilder, find_device
from pbd_warp.scene import Scene
from pbd_warp.step.launch import Launcher
from pbd_warp.step.methods import Direct, GaussSeidel, Method

GRAVITY = 9.81
"""[m/s^2]"""

TAUT = 1e-3
"""A rope with less slack than this fraction of its length hangs by forces that grow without bounds as it goes to 0."""


@dataclass(frozen=True)
class StageScene:
    """What a stage has to simulate.

    scene: The ropes and colliders, particles in the order of `curves`, and the settings to simulate them. Others come
        from `changed`; frames and fps are the timeline's.
    origin: Of the simulation in world space [m]: positions in float32 are finest near it.
    """

    path: Path
    stage: Usd.Stage
    timeline: Timeline
    curves: list[Curves]
    origin: np.ndarray
    scene: Scene
    device: wp.Device
    dtype: str

    def changed(self, **changes: Any) -> StageScene:
        """The same curves simulated with other settings, by name."""
        return replace(self, scene=self.scene.changed(**changes))


def load_stage(
    path: Path,
    prims: Sequence[str] = (),
    collide: Sequence[str] = (),
    material: Material | None = None,
    gravity: float = GRAVITY,
    frames: int | None = None,
    fps: float | None = None,
    device: Any = None,
    dtype: str = "float32",
) -> StageScene:
    """Read what there is to simulate.

    Args:
        prims: Patterns of the paths of BasisCurves; all unless given.
        collide: Patterns of the paths of planes and spheres to collide with.
        material: What all ropes are made of; where it says nothing, what their prims say.
        gravity: Against the stage's up axis [m/s^2].
        frames, fps: As in `timeline`.

    Raises:
        InputError: what cannot be read, makes no sense or is not modelled.
    """
    if dtype not in DTYPES:
        raise unknown("dtype", dtype, DTYPES)
    where = find_device(device)
    stage = open_stage(path)
    time = timeline(stage, frames, fps)
    codes = time.time_codes
    curves = [Curves(prim, codes, (material or Material()).of(prim)) for prim in find_curves(stage, prims)]
    origin = np.concatenate([each.x for each in curves]).mean(axis=0)
    axis = UsdGeom.GetStageUpAxis(stage)
    if axis not in (UsdGeom.Tokens.y, UsdGeom.Tokens.z):
        raise InputError(f"{path}: upAxis must be Y or Z, not {axis!r}")
    up = axis == UsdGeom.Tokens.y
    builder = ModelBuilder(-check.number("gravity", gravity) * (np.eye(3)[1] if up else np.eye(3)[2]))
    for each in curves:
        _add_ropes(builder, each, origin, where, dtype)
    for prim in find_colliders(stage, collide):
        add_collider(builder, prim, codes, origin)
    method, substeps = _settings(curves, codes, bool(collide))
    scene = Scene(builder, time.frames, fps=time.fps, substeps=substeps, method=method, name=path.stem)
    return StageScene(path, stage, time, curves, origin, scene, where, dtype)


def _add_ropes(builder: ModelBuilder, curves: Curves, origin: np.ndarray, device: wp.Device, dtype: str) -> None:
    x, edges = curves.x - origin, curves.edges
    length = seen_lengths(x, edges, device, dtype)
    zero = np.flatnonzero(length == 0.0)
    if zero.size:
        i = edges[zero[0]][0]
        curve = curves.curve[i]
        number = i - np.flatnonzero(curves.curve == curve)[0]
        raise InputError(
            f"{curves.path}: curve {curve} has a segment of zero length after its point {number} "
            "(of those simulated): take one of the two points away"
        )
    added = builder.add_particles(x, mass=_masses(curves, edges, length), radius=0.5 * curves.width)
    builder.add_distances((edges + added.start).astype(np.int32), length, compliance=curves.material.compliance or 0.0)


def _masses(curves: Curves, edges: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Of the simulation points [kg]; half of each link at either end, pinned ones 0."""
    material = curves.material
    link = length
    if material.mass is None:
        assert material.density is not None
        link = material.density * np.pi / 4.0 * np.mean(curves.width[edges] ** 2, axis=1) * length
    mass = np.bincount(edges.ravel(), np.repeat(0.5 * link, 2), minlength=len(curves.x))
    light = np.flatnonzero((mass == 0.0) & ~curves.pinned)
    if light.size:
        raise InputError(
            f"{curves.path}: curve {curves.curve[light[0]]} has widths of 0, so a density gives it no mass: "
            "give widths above 0 or a mass"
        )
    if material.mass is not None:
        mass *= (material.mass / np.bincount(curves.curve, mass))[curves.curve]
    mass[curves.pinned] = 0.0
    return mass


def seen_lengths(x: np.ndarray, edges: np.ndarray, device: wp.Device, dtype: str) -> np.ndarray:
    """Lengths of links as the kernels will see them [m], rounding included, float64 [links].

    A link that is as long as it should be to the last bit is not moved, so a rope at rest stays at rest.
    """
    real = DTYPES[dtype]
    length = wp.zeros(len(edges), dtype=real, device=device)
    Launcher(device, real)(
        measure_distance,
        len(edges),
        wp.array(edges, dtype=wp.vec2i, device=device),
        wp.array(x, dtype=PRECISIONS[real]["Vec3"], device=device),
        length,
    )
    return length.numpy().astype(np.float64)


def _settings(curves: list[Curves], time_codes: np.ndarray, colliders: bool) -> tuple[Method, int]:
    """Method and substeps unless the user says otherwise: Direct where it is sure of a solution and fast."""
    if colliders or any(each.topology.closed or _taut(each, time_codes) for each in curves):
        return GaussSeidel(iterations=1), 64
    return Direct(), 16


def _taut(curves: Curves, time_codes: np.ndarray) -> bool:
    """Whether pins ever hold a part of an open curve, with free points in it, as far apart as it is long."""
    x, pinned = curves.x, np.flatnonzero(curves.pinned)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(x, axis=0), axis=1))])
    parts = np.flatnonzero((np.diff(curves.curve[pinned]) == 0) & (np.diff(pinned) > 1))
    if not parts.size:
        return False
    slack = (1.0 - TAUT) * (along[pinned[parts + 1]] - along[pinned[parts]])
    for time_code in time_codes if curves.moving else time_codes[:1]:
        places = curves.pins(float(time_code))
        if np.any(np.linalg.norm(places[parts + 1] - places[parts], axis=1) > slack):
            return True
    return False
