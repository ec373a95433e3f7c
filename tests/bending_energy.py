"""Bending energy in NumPy, float64, written from its definition: shares nothing with the kernels or the model."""

import numpy as np

ROUNDED = 0.01


def energy(e1, e2, rest=0.0):
    """E l / B of many pairs of links, shape [..., 3] each."""
    product = np.linalg.norm(e1, axis=-1) * np.linalg.norm(e2, axis=-1)
    kb = 2.0 * np.cross(e1, e2) / (product + np.sum(e1 * e2, axis=-1))[..., None]
    size = np.linalg.norm(kb, axis=-1)
    cone = np.sqrt(size**2 + ROUNDED * rest**2) - np.sqrt((1.0 + ROUNDED) * rest**2)
    return np.where(rest > 0.0, 0.5 * (1.0 + ROUNDED) * cone**2, 0.5 * size**2)


def slopes(f, e, step=1e-6):
    """Central differences of f, values of shape [m, ...], in the components of e, shape [m, 6]: [m, ..., 6]."""
    columns = [(f(e + step * axis) - f(e - step * axis)) / (2.0 * step) for axis in np.eye(6)]
    return np.stack(columns, axis=-1)
