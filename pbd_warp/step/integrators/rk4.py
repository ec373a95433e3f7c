"""The classical Runge-Kutta method, of order 4."""

from __future__ import annotations

from pbd_warp.step.integrators.coefficients import ORDER_4
from pbd_warp.step.integrators.explicit import Explicit


class RK4(Explicit):
    """Four stages a step: less than half the time of "dop853", where an error between a thousandth and a hundredth of
    the scene will do, or where next to nothing moves.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.1.
    """

    name = "rk4"
    order = 4
    estimates = False
    tableau = ORDER_4
    stable = 2.8
