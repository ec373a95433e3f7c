"""The cost sheet: what one frame of a scene costs, read off the simulation itself."""

from __future__ import annotations

from itertools import groupby

from pbd_warp.model.model import Model
from pbd_warp.settings import Settings
from pbd_warp.simulation import Simulation

MOST_PROJECTIONS = 1e9
"""Of constraints in a frame; some seconds on a CPU."""

LAUNCH = 1000
"""Projections that take as long as the launch of a kernel on none."""


def too_much(model: Model, settings: Settings) -> str | None:
    """A sentence on settings with which a frame takes very long, None where it does not."""
    steps = settings.dt / settings.step_dt
    work = steps * settings.method.iterations * (model.constraint_count + LAUNCH)
    if work <= MOST_PROJECTIONS:
        return None
    return f"each frame takes {work:.1g} projections of constraints, which is minutes or more, with {settings}"


def cost_sheet(sim: Simulation) -> str:
    """Passes of a step, launches of a frame, bytes on the device, as text."""
    passes = sim.passes
    model = sim.model
    memory = sim.memory
    total = sum(memory.values())
    lines = [
        f"particles        {model.particle_count}",
        f"constraints      {model.constraint_count}",
        f"steps a frame    {round(sim.dt / sim.settings.step_dt)} of {1e3 * sim.settings.step_dt:.4g} ms",
        f"passes a step    {len(passes)}",
        f"launches a frame {sim.launches}{', which makes all passes' if sim.fused else ''}",
        f"device memory    {total} bytes, {total / model.particle_count:.1f} a particle",
        "",
        "passes of a step, in order:",
        *(f"  {text}" for text in _fold(passes)),
        "",
        "arrays:",
        *(f"  {name:24} {size:>10} bytes" for name, size in memory.items() if size),
    ]
    return "\n".join(lines)


def _fold(passes: list[str]) -> list[str]:
    """Repeated runs of passes, such as the sweeps of a solver, written once with their number."""
    folded: list[str] = []
    start = 0
    while start < len(passes):
        length, times = _longest_repeat(passes, start)
        block = " -> ".join(f"{name} x{n}" if n > 1 else name for name, n in _runs(passes[start : start + length]))
        folded.append(f"{times} x ({block})" if times > 1 else block)
        start += length * times
    return folded


def _longest_repeat(passes: list[str], start: int) -> tuple[int, int]:
    best = (1, 1)
    for length in range(1, 8):
        block = passes[start : start + length]
        times = 1
        while passes[start + times * length : start + (times + 1) * length] == block:
            times += 1
        if times > 1 and length * times > best[0] * best[1]:
            best = (length, times)
    return best


def _runs(names: list[str]) -> list[tuple[str, int]]:
    return [(name, len(list(group))) for name, group in groupby(names)]
