"""Frames in one launch: a machine that walks a recorded step and calls its passes one after another.

The program is an array of operations (code, which, count, target). A code of 0 or more is a pass: its function is
called at every index below `count` with the arguments that stand at `which` in the pass's own array. The rest is how
the walk goes on:
    WHILE   to `target` where condition `which` is 0         BACK   to `target`
    STEP    to `target` until it was met `count` times       FRAME  the frame is made: the next, unless this one failed

On the CPU one thread makes it all. On a GPU it is one block: each pass is shared among its threads, which wait for each
other after it. Ours; measured against launches by `python benchmarks/frames.py`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp

from pbd_warp.kernels.divergence import failed
from pbd_warp.kernels.precision import StepPass, build_kernel, from_text, index

WHILE, BACK, STEP, FRAME = -1, -2, -3, -4


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def wait():
    """Until all threads of the block are here."""
    ...


def arguments_of(step_pass: StepPass, real: type) -> Any:
    """The arguments of a pass as a Warp struct: an array of them takes what a kernel takes at launch."""
    cls = type(f"{step_pass.name}_arguments", (), {"__annotations__": step_pass.arguments[real]})
    cls.__module__ = __name__
    return wp.struct(cls, module=f"{__name__}.{real.__name__}")


def build(name: str, passes: Sequence[StepPass], structs: Sequence[Any], real: type) -> wp.Kernel:
    """The machine for these passes, whose codes are their places in the sequence.

    Its arguments: program, vec4i [operations]; conditions, int32; diverged, as the step has it; control, int32 [2]:
    frames wanted, frames made; and of each pass its array of structs.
    """
    module = f"{__name__}.{name}.{real.__name__}"
    scope: dict[str, Any] = {"wp": wp, "wait": wait, "failed": failed}
    branches = []
    for code, (step_pass, struct) in enumerate(zip(passes, structs, strict=True)):
        scope[f"run_{code}"] = _run(step_pass, struct, real, module)
        branches.append(
            f"        {'el' if code else ''}if code == {code}:\n"
            f"            run_{code}(lane, op[2], op[1], arguments_{code})\n            wait()\n"
        )
    names = ", ".join(f"arguments_{code}" for code in range(len(passes)))
    text = f"def {name}(program, conditions, diverged, control, {names}):\n" + _WALK.format(passes="".join(branches))
    arguments = {"program": wp.array[wp.vec4i], "conditions": wp.array[wp.int32]}
    arguments |= {"diverged": wp.array[wp.int32], "control": wp.array[wp.int32]}
    arguments |= {f"arguments_{code}": wp.array[struct] for code, struct in enumerate(structs)}
    return build_kernel(from_text(text, scope, arguments), module)


_WALK = """\
    lane = wp.tid()
    frames = control[0]
    made = int(0)
    steps = int(0)
    at = int(0)
    while made < frames:
        op = program[at]
        code = op[0]
        at = at + 1
{passes}        elif code == -1:
            if conditions[op[1]] == 0:
                at = op[3]
        elif code == -2:
            at = op[3]
        elif code == -3:
            steps = steps + 1
            if steps < op[2]:
                at = op[3]
            else:
                steps = int(0)
        else:
            made = made + 1
            at = int(0)
            if failed(diverged):
                frames = made
    if lane == 0:
        control[1] = made
"""


def _run(step_pass: StepPass, struct: Any, real: type, module: str) -> Any:
    """A pass over all its indices, with the arguments at a place of their array."""
    names = list(step_pass.arguments[real])
    arrays = [n for n, t in step_pass.arguments[real].items() if hasattr(t, "dtype") and getattr(t, "ndim", 0) == 1]
    types = {n: step_pass.arguments[real][n] for n in arrays}
    scope: dict[str, Any] = {"wp": wp, "index": index, "at": step_pass.functions[real]}
    packed = from_text(f"def packed_{step_pass.name}({', '.join(arrays)}):\n    ...\n", {}, types)
    snippet = "\n".join(f"__builtin_assume({n}.strides[0] == (int)sizeof(*{n}.data));" for n in arrays)
    scope["packed"] = wp.func_native(snippet)(packed)
    text = (
        f"def run_{step_pass.name}(lane, count, which, arguments):\n"
        "    a = arguments[which]\n"
        f"    packed({', '.join(f'a.{n}' for n in arrays)})\n"
        "    i = int(lane)\n"
        "    while i < count:\n"
        f"        at({', '.join(['index(i)', *(f'a.{n}' for n in names)])})\n"
        "        i = i + wp.block_dim()\n"
    )
    arguments = {"lane": wp.int32, "count": wp.int32, "which": wp.int32, "arguments": wp.array[struct]}
    return wp.func(from_text(text, scope, arguments), name=f"run_{step_pass.name}", module=module, inline=False)
