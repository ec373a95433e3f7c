"""Coefficients of explicit Runge-Kutta methods: against SciPy's, and against what their order demands."""

import math

import numpy as np
import pytest
from scipy.integrate._ivp import dop853_coefficients as scipy_dop853

from pbd_warp.step.integrators.coefficients import ORDER_4, ORDER_8


def test_dop853_is_scipys():
    stages = scipy_dop853.N_STAGES
    np.testing.assert_array_equal(ORDER_8.a, scipy_dop853.A[:stages, :stages])
    np.testing.assert_array_equal(ORDER_8.b, scipy_dop853.B)
    np.testing.assert_array_equal(ORDER_8.e5, scipy_dop853.E5[:stages])
    np.testing.assert_array_equal(ORDER_8.e3, scipy_dop853.E3[:stages])
    np.testing.assert_allclose(ORDER_8.c, scipy_dop853.C[:stages], rtol=0, atol=2e-15)


@pytest.mark.parametrize(("t", "q"), [(ORDER_8, q) for q in range(1, 10)] + [(ORDER_4, q) for q in range(1, 6)])
def test_order_conditions(t, q):
    """Those of quadrature, b c^(q-1) = 1/q, and of the linear equation, b a^(q-1) 1 = 1/q!, hold up to the order."""
    quadrature = t.b @ t.c ** (q - 1) - 1.0 / q
    linear = t.b @ np.linalg.matrix_power(t.a, q - 1) @ np.ones(len(t.b)) - 1.0 / math.factorial(q)
    if q <= t.order:
        assert abs(quadrature) < 1e-14
        assert abs(linear) < 1e-14
    else:
        assert abs(linear) > 1e-8


@pytest.mark.parametrize(("estimate", "order"), [("e5", 5), ("e3", 3)])
def test_what_is_embedded_has_its_order(estimate, order):
    t = ORDER_8
    moments = [getattr(t, estimate) @ t.c ** (q - 1) for q in range(1, order + 2)]
    np.testing.assert_allclose(moments[:order], 0.0, atol=1e-14)
    assert abs(moments[order]) > 1e-4


def test_positions_are_velocities_integrated():
    """x' = v, v' = a with a given polynomial in time: the step is exact up to the order."""
    t = ORDER_8
    h, power = 0.7, t.order - 2
    k = (t.c * h) ** power
    x = h**2 * t.to_position[-1] @ k
    v = h * t.to_velocity[-1] @ k
    assert x == pytest.approx(h ** (power + 2) / ((power + 1) * (power + 2)), rel=1e-13)
    assert v == pytest.approx(h ** (power + 1) / (power + 1), rel=1e-13)
