"""Where bezier curves are smooth: knots whose two handles lie in line.

There (P_k - P_{k-1}) / a = (P_{k+1} - P_k) / b with the handles' lengths a and b: as long as this holds, with the ratio
that they have at rest, the curve has no kink. It is linear in the control points, and any affine motion keeps it.
"""

from __future__ import annotations

import numpy as np

from pbd_warp.curves.basis import BasisKind
from pbd_warp.curves.sampling import Kind, Weights

IN_LINE = 1e-3
"""Between the directions of handles that count as in line, in radians: rounding, and what an exporter leaves."""


def smooth_joints(kind: Kind) -> Weights:
    """Sums of control values that are 0 where the curves are smooth, a row a knot."""
    none = Weights(np.zeros((0, 3), int), np.zeros((0, 3)))
    if not isinstance(kind, BasisKind) or kind.basis != "bezier" or not len(kind.counts):
        return none
    first = np.cumsum(kind.counts) - kind.counts
    knots = []
    for begin, n, segments in zip(first.tolist(), kind.counts.tolist(), kind.segments.tolist(), strict=True):
        own = 3 * np.arange(0 if kind.closed else 1, segments)
        knots.append(begin + np.stack([own - 1, own, own + 1], axis=1) % n if n else np.zeros((0, 3), int))
    index = np.concatenate(knots)
    before, at, after = kind.points[index].transpose(1, 0, 2)
    a, b = np.linalg.norm(at - before, axis=1), np.linalg.norm(after - at, axis=1)
    some = (a > 0.0) & (b > 0.0)
    index, a, b = index[some], a[some], b[some]
    apart = (at - before)[some] / a[:, None] - (after - at)[some] / b[:, None]
    weight = np.stack([-b, a + b, -a], axis=1) / (a + b)[:, None]
    smooth = np.linalg.norm(apart, axis=1) <= IN_LINE
    return Weights(index[smooth], weight[smooth])
