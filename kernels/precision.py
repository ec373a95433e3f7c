"""One source, two precisions, and two ways to run it.

A kernel is written once with the names `Real`, `Vec3` and `Mat33` for its types and literals, and
`@kernel` builds it twice: `kernel[wp.float32]` and `kernel[wp.float64]`. Both can run in one process.
`@step_pass` takes a function of an index instead: it too becomes such kernels, which call it for every index, and
the fused frame (frame.py) calls the same function in a loop of its own.

Ours, instead of Warp's `Any` + `wp.overload`: every argument's type is spelled out and bound at import,
so a launch infers nothing, and each precision lies in a Warp module of its own
(`pbd_warp.kernels.<file>.float32`), so a run compiles only the precision that it uses.
"""

import linecache
import types
from collections.abc import Callable
from typing import Any

import warp as wp

# What an editor sees; each precision replaces them by the types below.
Real = wp.float32
Vec3 = wp.vec3f
Mat33 = wp.mat33f

PRECISIONS = {
    wp.float32: {"Real": wp.float32, "Vec3": wp.vec3f, "Mat33": wp.mat33f},
    wp.float64: {"Real": wp.float64, "Vec3": wp.vec3d, "Mat33": wp.mat33d},
}

MODULES: list[str] = []
"""Names of all Warp modules made so far (the CUDA compile test goes through them)."""


@wp.func_native("__builtin_assume(i >= 0); return i;")
def index(i: wp.int32) -> wp.int32:
    """An index that is not negative, which the compiler cannot know of one that was read from memory: it need not be
    ready to count from the end then, which costs a third of a sweep (benchmarks/step.py)."""
    ...


class PrecisionFunction:
    """A `wp.func` in each precision, for kernels and passes of its file that need one with `Real` or `Vec3` in it."""

    def __init__(self, source: Callable):
        self.name = source.__name__
        self.functions = {real: _function(source, real) for real in PRECISIONS}


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
        self.functions = {real: _function(source, real) for real in PRECISIONS}
        self.arguments = {real: dict(list(_annotations(source, real).items())[1:]) for real in PRECISIONS}
        super().__init__(source.__name__, {real: self._kernel(source, real) for real in PRECISIONS})

    def _kernel(self, source: Callable, real: type) -> wp.Kernel:
        names = ", ".join(self.arguments[real])
        text = f"def {source.__name__}({names}):\n    at(wp.tid(), {names})\n"
        scope = {"wp": wp, "at": self.functions[real]}
        made = from_text(text, scope, self.arguments[real])
        return wp.kernel(made, module=_module(source, real), enable_backward=False)


def kernel(source: Callable) -> PrecisionKernel:
    """Decorator: build `source` in float32 and in float64.

    The file that holds `source` needs `from __future__ import annotations`, so that the annotations
    are still text here and can be evaluated once for each precision.
    """
    kernels = {
        real: wp.kernel(_copy(source, real), module=_module(source, real), enable_backward=False) for real in PRECISIONS
    }
    return PrecisionKernel(source.__name__, kernels)


def step_pass(source: Callable) -> StepPass:
    """Decorator: as `kernel`, for a function whose first argument is the index."""
    return StepPass(source)


def function(source: Callable) -> PrecisionFunction:
    """Decorator: a `wp.func` in float32 and in float64."""
    return PrecisionFunction(source)


def from_text(text: str, scope: dict[str, Any], arguments: dict[str, Any]) -> Callable:
    """A Python function whose source was put together, where `wp.func` and `wp.kernel` find it."""
    name = text[len("def ") : text.index("(")]
    file = f"<{name} of {hash(text)}>"
    linecache.cache[file] = (len(text), None, text.splitlines(keepends=True), file)
    exec(compile(text, file, "exec"), scope)
    made: Callable = scope[name]
    made.__module__, made.__qualname__, made.__annotations__ = __name__, name, dict(arguments)
    return made


def _function(source: Callable, real: type) -> Any:
    copy = _copy(source, real)
    return wp.func(copy, name=source.__name__, module=_module(source, real))


def _module(source: Callable, real: type) -> str:
    """`pbd_warp.kernels.distance` -> `pbd_warp.kernels.distance.float32`."""
    name = f"{source.__module__}.{real.__name__}"
    if name not in MODULES:
        MODULES.append(name)
    return name


def _scope(source: Callable, real: type) -> dict[str, Any]:
    functions = {n: f.functions[real] for n, f in source.__globals__.items() if isinstance(f, PrecisionFunction)}
    return {**source.__globals__, **PRECISIONS[real], **functions}


def _annotations(source: Callable, real: type) -> dict[str, Any]:
    scope = _scope(source, real)
    return {name: eval(text, scope) for name, text in source.__annotations__.items()}


def _copy(source: Callable, real: type) -> Callable:
    copy = types.FunctionType(source.__code__, _scope(source, real), source.__name__)
    copy.__module__, copy.__qualname__, copy.__doc__ = source.__module__, source.__qualname__, source.__doc__
    copy.__annotations__ = _annotations(source, real)
    return copy
