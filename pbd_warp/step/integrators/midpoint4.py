"""Five midpoint steps that together are of fourth order."""

from __future__ import annotations

from pbd_warp.step.integrators.midpoint import Midpoint

S = 1.0 / (4.0 - 4.0 ** (1.0 / 3.0))


class Midpoint4(Midpoint):
    """ "midpoint" steps of the lengths s, s, 1 - 4 s, s, s with s = 1/(4 - 4^(1/3)); the third goes back in time.

    Source: Suzuki 1990, Fractal decomposition of exponential operators, in Hairer, Lubich, Wanner: Geometric Numerical
    Integration, section II.4: a symmetric composition of a symmetric method of order 2 has order 4. So have positions;
    velocities have order 2 in the part that would stretch rigid links, which the next step takes out again.
    """

    order = 4
    composition = (S, S, 1.0 - 4.0 * S, S, S)
