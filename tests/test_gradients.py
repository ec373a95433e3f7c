"""The gradient of each constraint function against central differences, in float64."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from pbd_warp.kernels.collider import sphere_normal
from pbd_warp.kernels.distance import distance

STEP = 1e-5
"""Truncation ~ STEP^2 |C'''| ~ 1e-9 for lengths of some 0.3 m and more, round-off ~ 1e-16 / STEP."""


@wp.kernel(enable_backward=False)
def evaluate_distance(d: wp.array[wp.vec3d], c: wp.array[wp.float64], gradient: wp.array[wp.vec3d]):
    i = wp.tid()
    value, direction = distance(d[i], wp.float64(0.5))
    c[i] = value
    gradient[i] = direction


@wp.kernel(enable_backward=False)
def evaluate_sphere(d: wp.array[wp.vec3d], c: wp.array[wp.float64], gradient: wp.array[wp.vec3d]):
    """C = |s| - 0.5 through the normal that a particle at rest inside the sphere gets."""
    i = wp.tid()
    gradient[i] = sphere_normal(d[i], wp.vec3d(), wp.float64(0.5))
    c[i] = wp.dot(gradient[i], d[i]) - wp.float64(0.5)


def evaluate(kernel, d):
    c, gradient = wp.zeros(len(d), dtype=wp.float64), wp.zeros(len(d), dtype=wp.vec3d)
    wp.launch(kernel, dim=len(d), inputs=[wp.array(d, dtype=wp.vec3d), c, gradient])
    return c.numpy(), gradient.numpy()


@pytest.mark.parametrize("kernel", [evaluate_distance, evaluate_sphere], ids=["distance", "sphere"])
def test_gradient_is_the_derivative(kernel, rng):
    d = rng.normal(size=(50, 3))
    d *= np.maximum(1.0, 0.3 / np.linalg.norm(d, axis=1))[:, None]
    _, gradient = evaluate(kernel, d)
    for axis in range(3):
        e = STEP * np.eye(3)[axis]
        slope = (evaluate(kernel, d + e)[0] - evaluate(kernel, d - e)[0]) / (2.0 * STEP)
        np.testing.assert_allclose(gradient[:, axis], slope, atol=1e-8)


@pytest.mark.parametrize("kernel", [evaluate_distance, evaluate_sphere], ids=["distance", "sphere"])
def test_zero_length_has_a_unit_direction(kernel):
    c, gradient = evaluate(kernel, np.zeros((1, 3)))
    assert c[0] == -0.5
    np.testing.assert_array_equal(gradient[0], [1, 0, 0])
