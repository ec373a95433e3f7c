"""What simulation points did, brought back to the control values of their curves by least squares."""

from __future__ import annotations

import numpy as np

from pbd_warp.curves.joints import smooth_joints
from pbd_warp.curves.sampling import Sampling
from pbd_warp.errors import InputError

WEAK = 1e-6
"""A control value that moves no simulation point by more than this part of its own way is held back by as much."""

GIVE = 1e-10
"""By so much a curve may miss a pinned point, relative to what it misses the others by: pins may be more than it can
go through."""


SMOOTH = 1e4
"""What a kink counts, squared, where there was none, against what a simulation point is missed by: a ten-thousandth of
it is left. Pinned points, which are constraints, come first, to GIVE times this."""


class Fit:
    """Takes displacements (or velocities) of simulation points back to control values: the unknowns P that minimise

    |M P - d|^2 + SMOOTH |J P|^2  subject to  M_i P = d_i at pinned points i

    with d the displacements, M the sampling, and J the joints at which beziers are smooth (joints.py). Exact for what
    control points can do: rest, affine motion, any motion of a bezier that has corners at its knots. All curves are one
    sparse system, banded along each: its factors take time and memory that grow with the number of control points.

    Args:
        pinned: Which simulation points are pinned, bool [samples].

    Raises:
        InputError: SciPy is not installed (linear curves need none).
    """

    def __init__(self, sampling: Sampling, pinned: np.ndarray):
        self._unknown = sampling.unknown
        self._copies = sampling.points.copies
        if self._copies:
            return
        try:
            from scipy.sparse import block_array, coo_array, diags_array
            from scipy.sparse.csgraph import reverse_cuthill_mckee
            from scipy.sparse.linalg import splu
        except ImportError:
            raise InputError("curves that are not linear need SciPy: pip install 'pbd-warp[curves]'") from None
        points = sampling.points
        rows = np.broadcast_to(np.arange(sampling.count)[:, None], points.index.shape)
        entries = points.weight.ravel(), (rows.ravel(), sampling.unknown[points.index].ravel())
        matrix = coo_array(entries, (sampling.count, sampling.unknown_count)).tocsr()
        matrix.eliminate_zeros()
        normal = (matrix.T @ matrix).tocsr()
        joints = smooth_joints(sampling.kind)
        simulated = sampling.unknown[joints.index[:, 0]] >= 0
        at, weight = sampling.unknown[joints.index[simulated]], joints.weight[simulated]
        row = np.broadcast_to(np.arange(len(at))[:, None], at.shape)
        bend = coo_array((weight.ravel(), (row.ravel(), at.ravel())), (len(at), sampling.unknown_count)).tocsr()
        normal = (normal + SMOOTH * (bend.T @ bend)).tocsr()
        system = normal + diags_array(np.where(normal.diagonal() < WEAK, WEAK, 0.0))
        self._pinned = pinned
        held = matrix[np.flatnonzero(pinned)]
        if held.shape[0]:
            system = block_array([[system, held.T], [held, diags_array(np.full(held.shape[0], -GIVE))]])
        self._transposed = matrix.T.tocsr()
        system = system.tocsr()
        self._order = reverse_cuthill_mckee(system, symmetric_mode=True)
        self._factors = splu(system[self._order][:, self._order].tocsc(), permc_spec="NATURAL")

    def __call__(self, displacement: np.ndarray) -> np.ndarray:
        """Of simulation points [samples, 3] to that of control values [values, 3]; 0 for those not simulated."""
        if self._copies:
            moved = displacement
        else:
            sums = np.concatenate([self._transposed @ displacement, displacement[self._pinned]])
            solution = np.empty_like(sums)
            solution[self._order] = self._factors.solve(sums[self._order])
            moved = solution[: self._transposed.shape[0]]
        return np.where(self._unknown[:, None] >= 0, moved[self._unknown], 0.0)
