"""Dormand and Prince's method of order 8, with an estimate of its error."""

from __future__ import annotations

from pbd_warp.step.integrators.coefficients import ORDER_8
from pbd_warp.step.integrators.explicit import Explicit


class DOP853(Explicit):
    """Twelve stages a step; from some 1e-3 of a link's length down nothing here is faster.

    Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.5.
    """

    name = "dop853"
    order = 8
    estimates = True
    tableau = ORDER_8
    stable = 5.9
