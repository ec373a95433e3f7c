"""Coefficients of explicit Runge-Kutta methods."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Tableau:
    """An explicit method of `stages` s: a [s, s], b [s], and two error estimates e5, e3 [s], b less an embedded b.

    The time of a stage, c, is the sum of its row of a.
    """

    order: int
    a: np.ndarray
    b: np.ndarray
    e5: np.ndarray
    e3: np.ndarray

    @property
    def c(self) -> np.ndarray:
        return self.a.sum(axis=1)

    @property
    def to_velocity(self) -> np.ndarray:
        """Sums of accelerations that make the velocity of each stage and of the step, [s + 1, s]."""
        return np.vstack([self.a, self.b])

    @property
    def to_position(self) -> np.ndarray:
        """The same for positions, times the step's length once more, [s + 1, s]."""
        return self.to_velocity @ self.a

    @property
    def to_estimate(self) -> np.ndarray:
        """Sums of accelerations, times the step's length squared, that estimate a step's error, [2, s]: that of the
        position, and that of the velocity as the way it makes in one more step."""
        e = np.vstack([self.e5, self.e3])
        return e @ self.a + e


def _rows(*rows: dict[int, float]) -> np.ndarray:
    a = np.zeros((len(rows), len(rows)))
    for row, entries in enumerate(rows):
        a[row, list(entries)] = list(entries.values())
    return a


def _row(entries: dict[int, float], size: int) -> np.ndarray:
    row = np.zeros(size)
    row[list(entries)] = list(entries.values())
    return row


_DOP853_B = {
    0: 0.054293734116568765,
    5: 4.450312892752409,
    6: 1.8915178993145003,
    7: -5.801203960010585,
    8: 0.3111643669578199,
    9: -0.1521609496625161,
    10: 0.20136540080403034,
    11: 0.04471061572777259,
}

ORDER_8 = Tableau(
    order=8,
    a=_rows(
        {},
        {0: 0.05260015195876773},
        {0: 0.0197250569845379, 1: 0.0591751709536137},
        {0: 0.02958758547680685, 2: 0.08876275643042054},
        {0: 0.2413651341592667, 2: -0.8845494793282861, 3: 0.924834003261792},
        {0: 0.037037037037037035, 3: 0.17082860872947386, 4: 0.12546768756682242},
        {0: 0.037109375, 3: 0.17025221101954405, 4: 0.06021653898045596, 5: -0.017578125},
        {
            0: 0.03709200011850479,
            3: 0.17038392571223998,
            4: 0.10726203044637328,
            5: -0.015319437748624402,
            6: 0.008273789163814023,
        },
        {
            0: 0.6241109587160757,
            3: -3.3608926294469414,
            4: -0.868219346841726,
            5: 27.59209969944671,
            6: 20.154067550477894,
            7: -43.48988418106996,
        },
        {
            0: 0.47766253643826434,
            3: -2.4881146199716677,
            4: -0.590290826836843,
            5: 21.230051448181193,
            6: 15.279233632882423,
            7: -33.28821096898486,
            8: -0.020331201708508627,
        },
        {
            0: -0.9371424300859873,
            3: 5.186372428844064,
            4: 1.0914373489967295,
            5: -8.149787010746927,
            6: -18.52006565999696,
            7: 22.739487099350505,
            8: 2.4936055526796523,
            9: -3.0467644718982196,
        },
        {
            0: 2.273310147516538,
            3: -10.53449546673725,
            4: -2.0008720582248625,
            5: -17.9589318631188,
            6: 27.94888452941996,
            7: -2.8589982771350235,
            8: -8.87285693353063,
            9: 12.360567175794303,
            10: 0.6433927460157636,
        },
    ),
    b=_row(_DOP853_B, 12),
    e5=_row(
        {
            0: 0.01312004499419488,
            5: -1.2251564463762044,
            6: -0.4957589496572502,
            7: 1.6643771824549864,
            8: -0.35032884874997366,
            9: 0.3341791187130175,
            10: 0.08192320648511571,
            11: -0.022355307863886294,
        },
        12,
    ),
    e3=_row(_DOP853_B, 12)
    - _row(
        {
            0: 0.244094488188976377952755905512,
            8: 0.733846688281611857341361741547,
            11: 0.0220588235294117647058823529412,
        },
        12,
    ),
)
"""Dormand and Prince's method of order 8 in 12 stages with embedded ones of order 5 and 3, double precision.

Source: Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.5, and their program DOP853.
"""

_RK4_A = np.zeros((4, 4))
_RK4_A[1, 0] = _RK4_A[2, 1] = 0.5
_RK4_A[3, 2] = 1.0
ORDER_4 = Tableau(order=4, a=_RK4_A, b=np.array([1.0, 2.0, 2.0, 1.0]) / 6.0, e5=np.zeros(4), e3=np.zeros(4))
"""Kutta's method of 1901, without an estimate."""
