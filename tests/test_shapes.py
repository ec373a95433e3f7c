"""Distances and normals of shapes: what the nearest point lies on, and that no other point is nearer."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from kernel_io import REALS, tolerance, vec
from meshes import ball, cuboid, sheet, torus, volume

from pbd_warp.kernels.precision import Real, Vec3, kernel
from pbd_warp.kernels.shapes import BOX, CAPSULE, CONE, MESH, PLANE, SPHERE, entry, surface
from pbd_warp.model.meshes import checked_mesh, is_closed

FAR = 100.0


@kernel
def look(kind: wp.int32, size: Vec3, mesh: wp.uint64, s: wp.array[Vec3], d: wp.array[Real], n: wp.array[Vec3]):
    i = wp.tid()
    far, out = surface(kind, size, mesh, Real(FAR), s[i])
    d[i] = far
    n[i] = out


@kernel
def come(kind: wp.int32, size: Vec3, mesh: wp.uint64, radius: Real, start: Vec3, move: Vec3, out: wp.array[Vec3]):
    at, n = entry(kind, size, mesh, radius, Real(FAR), start, move)
    out[0] = at
    out[1] = n


def distance(real, kind, size, s, mesh=None):
    """Distances [n] and normals [n, 3] of places, float64."""
    s = np.atleast_2d(np.asarray(s, float))
    places = wp.array(s, dtype=vec(REALS[real]))
    d, n = wp.zeros(len(s), dtype=REALS[real]), wp.zeros(len(s), dtype=vec(REALS[real]))
    wp.launch(look[REALS[real]], len(s), inputs=[kind, vec(REALS[real])(*size), mesh.id if mesh else 0, places, d, n])
    return d.numpy().astype(float), n.numpy().astype(float)


def enter(real, kind, size, radius, start, move, mesh=None):
    out = wp.zeros(2, dtype=vec(REALS[real]))
    v = vec(REALS[real])
    wp.launch(come[REALS[real]], 1, inputs=[kind, v(*size), mesh.id if mesh else 0, radius, v(*start), v(*move), out])
    return out.numpy().astype(float)


def meshed(points, triangles):
    """The mesh on the device and the size of the collider."""
    points, triangles = checked_mesh(points, triangles)
    mesh = wp.Mesh(wp.array(points, dtype=wp.vec3), wp.array(triangles.ravel(), dtype=wp.int32))
    return mesh, (float(is_closed(points, triangles)), 0.5 * np.ptp(points, axis=0).min(), np.abs(points).max() * 2)


def outside(kind, size, s):
    """Of solids, by their definition: below 0 inside, 0 on the surface, above it outside."""
    rho, y = np.hypot(s[..., 0], s[..., 2]), s[..., 1]
    if kind == PLANE:
        return s @ np.array(size)
    if kind == SPHERE:
        return np.linalg.norm(s, axis=-1) - size[0]
    if kind == BOX:
        return np.max(np.abs(s) - size, axis=-1)
    if kind == CAPSULE:
        return np.hypot(rho, y - np.clip(y, -size[1], size[1])) - size[0]
    return np.maximum(rho - size[0] - (size[1] - size[0]) * (y + size[2]) / (2.0 * size[2]), np.abs(y) - size[2])


def on_surface(kind, size, rng, count=200_000):
    """Points of the surface: from random places along random ways to where the solid is left, by halving."""
    inner, outer = np.zeros((count, 3)), rng.normal(size=(count, 3))
    outer *= 5.0 / np.linalg.norm(outer, axis=1)[:, None]
    for _ in range(60):
        middle = 0.5 * (inner + outer)
        inside = outside(kind, size, middle) <= 0.0
        inner, outer = np.where(inside[:, None], middle, inner), np.where(inside[:, None], outer, middle)
    return inner


SOLIDS = {
    "plane": (PLANE, (0.48, 0.6, 0.64)),
    "sphere": (SPHERE, (0.7, 0.0, 0.0)),
    "box": (BOX, (0.5, 0.3, 0.8)),
    "capsule": (CAPSULE, (0.3, 0.6, 0.0)),
    "cylinder": (CONE, (0.4, 0.4, 0.5)),
    "cone": (CONE, (0.5, 0.0, 0.6)),
    "tapered": (CONE, (0.2, 0.9, 0.3)),
}


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("name", SOLIDS)
def test_the_nearest_point_is_on_the_surface_and_none_is_nearer(name, real, rng):
    kind, size = SOLIDS[name]
    s = rng.uniform(-1.2, 1.2, (300, 3))
    d, n = distance(real, kind, size, s)
    eps = 4.0 * tolerance(real)
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=eps)
    assert np.all(np.sign(d) == np.sign(outside(kind, size, s)))
    np.testing.assert_allclose(outside(kind, size, s - d[:, None] * n), 0.0, atol=8.0 * eps)
    if kind != PLANE:
        surface_points = on_surface(kind, size, rng)
        for place, far in zip(s[:40], d[:40], strict=True):
            nearest = np.linalg.norm(surface_points - place, axis=1).min()
            assert abs(far) - eps <= nearest <= abs(far) + 0.02


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("name", [name for name in SOLIDS if name != "plane"])
def test_their_middle_and_their_axis_have_a_way_out(name, real):
    kind, size = SOLIDS[name]
    d, n = distance(real, kind, size, [[0, 0, 0], [0, 0.1, 0], [0, 5, 0]])
    np.testing.assert_allclose(np.linalg.norm(n, axis=1), 1.0, atol=tolerance(real))
    assert np.all(d[:2] < 0.0)
    assert d[2] > 0.0


@pytest.mark.parametrize("real", ["float32", "float64"])
def test_a_box_of_triangles_is_the_box(real, rng):
    size = np.array([1.0, 0.6, 1.6])
    mesh, numbers = meshed(*cuboid(size))
    assert numbers[0] == 1.0
    assert volume(*cuboid(size)) == pytest.approx(size.prod())
    s = rng.uniform(-1.2, 1.2, (2000, 3))
    d, n = distance(real, MESH, numbers, s, mesh)
    expected, normal = distance(real, BOX, 0.5 * size, s)
    np.testing.assert_allclose(d, expected, atol=1e-6)  # its corners are float32
    depths = np.sort(0.5 * size - np.abs(s), axis=1)
    clear = (depths[:, 1] - depths[:, 0] > 1e-3) | (expected > 0.0)  # inside, between two faces, either may be nearest
    np.testing.assert_allclose(n[clear], normal[clear], atol=1e-5)


def test_a_ball_of_triangles_is_a_sphere_to_its_facets(rng):
    mesh, numbers = meshed(*ball(40))
    assert numbers[0] == 1.0, "its poles are closed"
    assert volume(*ball(40)) == pytest.approx(4.0 / 3.0 * np.pi, rel=0.01)
    s = rng.uniform(-1.2, 1.2, (2000, 3))
    d, n = distance("float64", MESH, numbers, s, mesh)
    sag = 1.0 - np.cos(np.pi / 40 / 2.0) ** 2  # of a facet, whose two sides are up to pi/40 long
    assert np.all(d - (np.linalg.norm(s, axis=1) - 1.0) <= 2.0 * sag)
    assert np.all(d - (np.linalg.norm(s, axis=1) - 1.0) >= -1e-6)
    away = np.linalg.norm(s, axis=1) > 0.5
    cosine = np.einsum("ij,ij->i", n, s)[away] / np.linalg.norm(s, axis=1)[away]
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < 6.0


def test_the_deepest_place_of_a_torus_finds_its_way_out():
    mesh, numbers = meshed(*torus())
    d, _ = distance("float64", MESH, numbers, [[0.3, 0, 0], [0, 0, 0]], mesh)
    assert d[0] == pytest.approx(-0.1, abs=2e-3)
    assert d[1] == pytest.approx(0.2, abs=2e-3)


@pytest.mark.parametrize("real", ["float32", "float64"])
@pytest.mark.parametrize("name", [*SOLIDS, "mesh"])
@pytest.mark.parametrize("radius", [0.0, 0.1])
def test_a_path_comes_in_where_it_first_touches(name, real, radius, rng):
    mesh = None
    if name == "mesh":
        kind, (mesh, size) = MESH, meshed(*torus())
    else:
        kind, size = SOLIDS[name]
    met = 0
    for _ in range(60):
        start, end = rng.uniform(-2.0, 2.0, 3), rng.uniform(-0.3, 0.3, 3)
        if distance(real, kind, size, start, mesh)[0][0] < radius:
            continue
        ts = np.linspace(0.0, 1.0, 4001)
        way = distance(real, kind, size, start + ts[:, None] * (end - start), mesh)[0]
        at, n = enter(real, kind, size, radius, start, end - start, mesh)
        inside = np.flatnonzero(way < radius - 1e-3)
        if inside.size:
            met += 1
            first = start + ts[inside[0]] * (end - start)
            # The ball where it is noted touches the surface, nearly, and has not gone in.
            far = (n @ (first - at)) - radius
            near = 0.06 * (radius + np.linalg.norm(end - start))
            assert n @ (start - at) - radius >= -near
            assert abs(far) <= 3.0 * near
        elif way.min() > radius + 1e-2 + 0.06 * (radius + np.linalg.norm(end - start)):
            np.testing.assert_allclose(n @ (end - at), way[-1], atol=1e-4)
    assert met >= 5


def test_through_a_thin_sheet_the_normal_is_on_the_side_it_came_from():
    mesh, size = meshed(*sheet())
    assert size[0] == 0.0
    for side in (1.0, -1.0):
        at, n = enter("float64", MESH, size, 0.01, (0.1, side, 0.2), (0.0, -2.0 * side, 0.0), mesh)
        np.testing.assert_allclose(n, [0, side, 0], atol=1e-6)
        assert at[1] == pytest.approx(0.0, abs=1e-6)
    at, n = enter("float64", MESH, size, 0.01, (3.0, 1.0, 0.0), (0.0, -2.0, 0.0), mesh)
    np.testing.assert_allclose(at, [1, 0, 0], atol=1e-6)  # past its border: the border is the nearest there is
