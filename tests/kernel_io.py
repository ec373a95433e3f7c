"""Runs one kernel on NumPy arrays: in as float64, out as float64, whatever the precision in between."""

import numpy as np
import warp as wp

REALS = {"float32": wp.float32, "float64": wp.float64}


def vec(real):
    return wp.types.vector(3, real)


def device_array(values, real):
    """float arrays in `real` ([n, 3] as vectors), integer arrays as int32 ([n, 2] as vec2i)."""
    values = np.asarray(values)
    if np.issubdtype(values.dtype, np.integer):
        return wp.array(values.astype(np.int32), dtype=wp.vec2i if values.ndim == 2 else wp.int32)
    if values.ndim == 3:
        return wp.array(values, dtype=wp.types.matrix((3, 3), real))
    return wp.array(values, dtype=vec(real) if values.ndim == 2 else real)


def run(kernel, real, dim, *args):
    """Launch over `dim` threads; arrays among `args` are copied in, and all of them are given back."""
    real = REALS[real]
    passed = [device_array(a, real) if isinstance(a, np.ndarray) else a for a in args]
    if dim:
        wp.launch(kernel[real], dim=dim, inputs=passed)
    return [p.numpy().astype(np.float64) if isinstance(p, wp.array) else p for p in passed]


def tolerance(real, operations=16.0):
    """Round-off of a value of size 1 after so many operations."""
    return operations * float(np.finfo(real).eps)
