"""Whether and how fast Jacobi sweeps converge on a graph: the eigenvalues of one sweep."""

from __future__ import annotations

import numpy as np

from pbd_warp.errors import InputError
from pbd_warp.model.model import Model

ITERATIONS = 200
"""Of the power iteration; its estimate comes from below. On a chain, whose eigenvalues lie closest, it is within 0.1 %
of 2 cos^2(pi/(2 N))."""


class JacobiSweep:
    """One sweep over all distances and points, linearised: it multiplies the error by 1 - relaxation * lambda, with
    lambda the eigenvalues of D^-1 A, so it converges for relaxation < 2 / lambda_max.

    A = J W J^T with J the gradients and W the inverse masses, D what the method divides by. Stiffness and compliance,
    which only help, are left out.

    Args:
        averaging: As in `Jacobi`.
        valence: Constraints at each particle, int [particle_count].
        x: Where it is linearised [m], [particle_count, 3]; the initial positions unless given.
    """

    def __init__(self, model: Model, averaging: str, valence: np.ndarray, x: np.ndarray | None = None):
        x = model.x if x is None else x
        self.edge, self.point = model.distance.edge, model.point.particle
        i, j = self.edge.T
        d = x[i] - x[j]
        length = np.linalg.norm(d, axis=1, keepdims=True)
        # Coincident particles are moved apart along the x axis, as in kernels/distance.py.
        self.gradient = np.divide(d, length, out=np.tile([1.0, 0.0, 0.0], (len(d), 1)), where=length > 0.0)
        count = np.maximum(valence, 1).astype(np.float64)
        w = model.w
        self.moves = w / count if averaging == "valence" else w
        weight = count * w if averaging == "mass-splitting" else w
        self.denominator = weight[i] + weight[j]
        self.point_denominator = weight[self.point]

    def largest_eigenvalue(self) -> float:
        """lambda_max, by power iteration; 0 where there are no constraints that can move anything."""
        i, j = self.edge.T
        scale, point_scale = _inverse(self.denominator)[:, None], _inverse(self.point_denominator)[:, None]
        u = np.random.default_rng(0).normal(size=(len(self.moves), 3)) * (self.moves[:, None] > 0.0)
        value = 0.0
        for _ in range(ITERATIONS):
            size = np.linalg.norm(u)
            if size == 0.0:
                return 0.0
            u /= size
            n = self.gradient
            dlam = scale * np.sum(n * (u[i] - u[j]), axis=1, keepdims=True) * n
            change = np.zeros_like(u)
            np.add.at(change, i, dlam)
            np.subtract.at(change, j, dlam)
            np.add.at(change, self.point, point_scale * u[self.point])
            u = self.moves[:, None] * change
            value = float(np.linalg.norm(u))
        return value

    def smallest_eigenvalue(self) -> float:
        """lambda_min of the symmetric form D^-1/2 A D^-1/2, by inverse iteration; needs SciPy."""
        try:
            from scipy.sparse import coo_array, diags_array, eye_array
            from scipy.sparse.linalg import eigsh
        except ImportError:
            raise InputError(
                "chebyshev='auto' needs SciPy: pip install 'pbd-warp[chart]', or give rho itself"
            ) from None
        m, points = len(self.edge), len(self.point)
        size = m + 3 * points
        axes = np.arange(3)
        rows = np.concatenate([np.repeat(np.arange(m), 3)] * 2 + [m + np.arange(3 * points)])
        columns = np.concatenate([(3 * p[:, None] + axes).ravel() for p in (*self.edge.T, self.point)])
        values = np.concatenate([self.gradient.ravel(), -self.gradient.ravel(), np.ones(3 * points)])
        jacobian = coo_array((values, (rows, columns)), shape=(size, 3 * len(self.moves))).tocsr()
        denominator = np.concatenate([self.denominator, np.repeat(self.point_denominator, 3)])
        scale = diags_array(np.sqrt(_inverse(denominator)))
        matrix = scale @ jacobian @ diags_array(np.repeat(self.moves, 3)) @ jacobian.T @ scale
        if size < 3:
            return float(np.linalg.eigvalsh(matrix.toarray())[0])
        # Shifted a little below 0: constraints that say the same twice make the matrix singular.
        shifted = matrix + 1e-12 * eye_array(size)
        return float(eigsh(shifted, k=1, sigma=0.0, which="LM", return_eigenvectors=False)[0])


def _inverse(values: np.ndarray) -> np.ndarray:
    return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0.0)
