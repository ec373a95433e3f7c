"""Curves as particles and distances of a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import warp as wp

from pbd_warp.curves.curves import Curves
from pbd_warp.errors import InputError
from pbd_warp.kernels.distance import measure_distance
from pbd_warp.kernels.precision import PRECISIONS
from pbd_warp.model.builder import DTYPES, ModelBuilder
from pbd_warp.step.launch import Launcher


def add_ropes(
    builder: ModelBuilder, curves: Sequence[Curves], origin: np.ndarray, device: wp.Device, dtype: str
) -> None:
    """Add all curves, in this order."""
    for each in curves:
        x, edges = each.x - origin, each.sampling.edges
        length = seen_lengths(x, edges, device, dtype)
        added = builder.add_particles(x, mass=_masses(each, edges, length), radius=0.5 * each.width)
        joined = (edges + added.start).astype(np.int32)
        area = np.pi / 4.0 * np.mean(each.width[edges] ** 2, axis=1)
        compliance = np.full(len(edges), each.material.compliance or 0.0)
        modulus = each.material.youngs_modulus
        if modulus is not None and not each.material.compliance:
            compliance = length / (modulus * area)
        builder.add_distances(joined, length, compliance=compliance)
        if modulus is not None or each.material.bending is not None:
            follows = np.flatnonzero(edges[:-1, 1] == edges[1:, 0])
            triples = np.concatenate([joined[follows], joined[follows + 1, 1:]], axis=1)
            middle = edges[follows, 1]
            stiffness = np.full(len(follows), each.material.bending)
            if modulus is not None:
                stiffness = modulus * np.pi * each.width[middle] ** 4 / 64.0
            builder.add_bendings(triples, stiffness, each.material.rest_shape or "straight")


def leave_what_has_no_length(
    curves: Sequence[Curves], origin: np.ndarray, device: wp.Device, dtype: str
) -> dict[str, str]:
    """Leave curves with a link of zero length. Gives the prims of which none is left, with the reason."""
    reasons = {}
    for each in curves:
        edges = each.sampling.edges
        zero = edges[seen_lengths(each.x - origin, edges, device, dtype) == 0.0, 0]
        if not zero.size:
            continue
        curve = each.sampling.curve
        number = zero - (np.cumsum(each.sampling.sample_counts) - each.sampling.sample_counts)[curve[zero]]
        try:
            each.leave(
                {
                    int(curve[at]): f"after its simulated point {k} comes a segment of zero length: take a point away"
                    for at, k in zip(zero[::-1], number[::-1], strict=True)
                }
            )
        except InputError as error:
            reasons[each.path] = str(error)
    return reasons


def _masses(curves: Curves, edges: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Of the simulation points [kg]; half of each link at either end, pinned ones 0."""
    material = curves.material
    link = length
    if material.mass is None:
        assert material.density is not None
        link = material.density * np.pi / 4.0 * np.mean(curves.width[edges] ** 2, axis=1) * length
    mass = np.bincount(edges.ravel(), np.repeat(0.5 * link, 2), minlength=len(curves.x))
    if material.mass is not None:
        curve = curves.sampling.curve
        mass *= (material.mass / np.maximum(np.bincount(curve, mass), np.finfo(float).tiny))[curve]
    mass[curves.pinned] = 0.0
    return mass


def seen_lengths(x: np.ndarray, edges: np.ndarray, device: wp.Device, dtype: str) -> np.ndarray:
    """Lengths of links as the kernels will see them [m], rounding included, float64 [links].

    A link that is as long as it should be to the last bit is not moved, so a rope at rest stays at rest; but `Direct`,
    which computes in float64, sees in float32 that its length was rounded, and moves it by as much.
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
