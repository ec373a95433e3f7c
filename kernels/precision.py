"""One kernel source, two precisions.

A kernel is written once with the names `Real`, `Vec3` and `Mat33` for its types and literals, and
`@kernel` builds it twice: `kernel[wp.float32]` and `kernel[wp.float64]`. Both can run in one process.

Ours, instead of Warp's `Any` + `wp.overload`: every argument's type is spelled out and bound at import,
so a launch infers nothing, and each precision lies in a Warp module of its own
(`pbd_warp.kernels.<file>.float32`), so a run compiles only the precision that it uses.
"""

import types
from collections.abc import Callable

import warp as wp

# What an editor sees; each precision replaces them by the types below.
Real = wp.float32
Vec3 = wp.vec3f
Mat33 = wp.mat33f

BLOCK = wp.constant(2)
"""Places whose vectors lie in one `Block`: sums over blocks compile to wider instructions than over single vectors
(a frame of "dop853" takes 1.2 times as long with 1, 1.05 to 1.1 times with 4 or 8)."""
Block = wp.types.vector(6, wp.float32)

PRECISIONS = {
    wp.float32: {"Real": wp.float32, "Vec3": wp.vec3f, "Mat33": wp.mat33f, "Block": Block},
    wp.float64: {"Real": wp.float64, "Vec3": wp.vec3d, "Mat33": wp.mat33d, "Block": wp.types.vector(6, wp.float64)},
}

MODULES: list[str] = []
"""Names of all Warp modules made so far (the CUDA compile test goes through them)."""


class PrecisionKernel:
    """A kernel in each precision: `self[wp.float32]`, `self[wp.float64]` are the Warp kernels."""

    def __init__(self, source: Callable):
        self.name = source.__name__
        self._kernels = {real: _build(source, real) for real in PRECISIONS}

    def __getitem__(self, real: type) -> wp.Kernel:
        return self._kernels[real]


def kernel(source: Callable) -> PrecisionKernel:
    """Decorator: build `source` in float32 and in float64.

    The file that holds `source` needs `from __future__ import annotations`, so that the annotations
    are still text here and can be evaluated once for each precision.
    """
    return PrecisionKernel(source)


class PrecisionFunction:
    """A function that kernels call, in each precision; `@kernel` puts the right one in its place."""

    def __init__(self, source: Callable):
        self._functions = {real: wp.func(_copy(source, real), module=_module(source, real)) for real in PRECISIONS}

    def __getitem__(self, real: type) -> wp.Function:
        return self._functions[real]


def func(source: Callable) -> PrecisionFunction:
    """Decorator: as `kernel`, for a function that has literals or local variables of the types above; one that has
    none is a `wp.func` with arguments of type Any."""
    return PrecisionFunction(source)


def _build(source: Callable, real: type) -> wp.Kernel:
    module = _module(source, real)
    if module not in MODULES:
        MODULES.append(module)
    return wp.kernel(_copy(source, real), module=module, enable_backward=False)


def _module(source: Callable, real: type) -> str:
    """`pbd_warp.kernels.distance` -> `pbd_warp.kernels.distance.float32`"""
    return f"{source.__module__}.{real.__name__}"


def _copy(source: Callable, real: type) -> types.FunctionType:
    """The function with the types, and the functions that it calls, of one precision."""
    names = {name: value[real] for name, value in source.__globals__.items() if isinstance(value, PrecisionFunction)}
    scope = {**source.__globals__, **names, **PRECISIONS[real]}
    copy = types.FunctionType(source.__code__, scope, source.__name__)
    copy.__module__, copy.__qualname__, copy.__doc__ = source.__module__, source.__qualname__, source.__doc__
    copy.__annotations__ = {name: eval(text, scope) for name, text in source.__annotations__.items()}
    return copy
