"""One source, two precisions, and two ways to run it.

A kernel is written once with the names `Real`, `Vec3`, `Vec4`, `Mat33` and `Quat` for its types and literals, and
`@kernel` builds it twice: `kernel[wp.float32]` and `kernel[wp.float64]`. Both can run in one process.
`@step_pass` takes a function of an index instead: it too becomes such kernels, which call it for every index, and
the fused frame (frame.py) calls the same function in a loop of its own.

Ours, instead of Warp's `Any` + `wp.overload`: every argument's type is spelled out and bound at import,
so a launch infers nothing, and each precision lies in a Warp module of its own
(`pbd_warp.kernels.<file>.float32`), so a run compiles only the precision that it uses.
"""

import linecache
import types
import zlib
from collections.abc import Callable
from typing import Any

import warp as wp

# What an editor sees; each precision replaces them by the types below.
Real = wp.float32
Vec3 = wp.vec3f
Vec4 = wp.vec4f
Mat33 = wp.mat33f
Quat = wp.quatf

BLOCK = wp.constant(2)
"""Places whose vectors lie in one `Block`: sums over blocks compile to wider instructions than over single vectors
(a frame of "dop853" takes 1.2 times as long with 1, 1.05 to 1.1 times with 4 or 8)."""
Block = wp.types.vector(6, wp.float32)

PRECISIONS = {
    wp.float32: {
        **{"Real": wp.float32, "Vec3": wp.vec3f, "Vec4": wp.vec4f, "Mat33": wp.mat33f, "Quat": wp.quatf},
        "Block": Block,
    },
    wp.float64: {
        **{"Real": wp.float64, "Vec3": wp.vec3d, "Vec4": wp.vec4d, "Mat33": wp.mat33d, "Quat": wp.quatd},
        "Block": wp.types.vector(6, wp.float64),
    },
}

MODULES: list[str] = []
"""Names of all Warp modules made so far (the CUDA compile test goes through them)."""


@wp.func_native("__builtin_assume(i >= 0); return i;")
def index(i: wp.int32) -> wp.int32:
    """An index that is not negative, which the compiler cannot know of one that was read from memory: it need not be
    ready to count from the end then, which is a quarter of a sweep (benchmarks/step.py with and without)."""
    ...


class PrecisionKernel:
    """A kernel in each precision: `self[wp.float32]`, `self[wp.float64]` are the Warp kernels."""

    def __init__(self, name: str, kernels: dict[type, wp.Kernel]):
        self.name = name
        self._kernels = kernels

    def __getitem__(self, real: type) -> wp.Kernel:
        return self._kernels[real]


class StepPass(PrecisionKernel):
    """What one pass over particles or constraints does at each index: `functions[real]` is the Warp function, whose
    first argument is the index, and `self[real]` the kernel that calls it over all of them."""

    def __init__(self, source: Callable):
        copies = {real: _copy(source, real) for real in PRECISIONS}
        self.functions = {real: wp.func(copies[real], module=_module(source, real)) for real in PRECISIONS}
        self.arguments = {real: dict(list(copies[real].__annotations__.items())[1:]) for real in PRECISIONS}
        super().__init__(source.__name__, {real: self._kernel(source, real) for real in PRECISIONS})

    def _kernel(self, source: Callable, real: type) -> wp.Kernel:
        names = ", ".join(self.arguments[real])
        text = f"def {source.__name__}({names}):\n    at(wp.tid(), {names})\n"
        made = from_text(text, {"wp": wp, "at": self.functions[real]}, self.arguments[real])
        return build_kernel(made, _module(source, real))


def kernel(source: Callable) -> PrecisionKernel:
    """Decorator: build `source` in float32 and in float64.

    The file that holds `source` needs `from __future__ import annotations`, so that the annotations
    are still text here and can be evaluated once for each precision.
    """
    kernels = {real: build_kernel(_copy(source, real), _module(source, real)) for real in PRECISIONS}
    return PrecisionKernel(source.__name__, kernels)


def step_pass(source: Callable) -> StepPass:
    """Decorator: as `kernel`, for a function whose first argument is the index."""
    return StepPass(source)


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


def from_text(text: str, scope: dict[str, Any], arguments: dict[str, Any]) -> types.FunctionType:
    """A Python function whose source was put together, where `wp.func` and `wp.kernel` find it."""
    name = text[len("def ") : text.index("(")]
    file = f"<{name} {zlib.crc32(text.encode()):08x}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    exec(compile(text, file, "exec"), scope)
    made: types.FunctionType = scope[name]
    made.__module__, made.__qualname__, made.__annotations__ = __name__, name, dict(arguments)
    return made


def build_kernel(source: types.FunctionType, module: str) -> wp.Kernel:
    if module not in MODULES:
        MODULES.append(module)
    return wp.kernel(source, module=module, enable_backward=False)


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
