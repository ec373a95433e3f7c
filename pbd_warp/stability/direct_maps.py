"""Maps of what Newton's method takes on: friction, unlike links, closed and taut graphs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pbd_warp.measure import measure
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.stability import theory
from pbd_warp.stability.cell import STEPS_A_FRAME, run_scene, size_of, stepped, study
from pbd_warp.stability.classify import Figures
from pbd_warp.stability.map import Axis, Boundary, Map, Panel
from pbd_warp.step.methods import Direct, GaussSeidel, Jacobi, Method

LINKS = 60
"""Of the rope over the ball."""


def _capstan(method: Method, steps: int) -> Panel:
    """A cell: the rope at friction x and load y for a second; off where it has moved by more than OFF of its size."""

    def cell(friction: float, load: float) -> Figures:
        over_polygon = load / theory.capstan(LINKS, friction)
        scene = study("capstan", load=over_polygon, friction=friction, links=LINKS)

        def slip(sim: Simulation) -> float:
            ends = sim.state.x.numpy()[[0, -1]] - sim.model.x[[0, -1]]
            return float(np.abs(ends).max() / size_of(sim.model))

        return run_scene(stepped(scene, steps).changed(frames=60, method=method), energy=False, error=slip)

    if not isinstance(method, Direct):
        return Panel(cell)  # which is not what the theory speaks of
    return Panel(cell, Boundary(lambda friction: theory.capstan(LINKS, friction), "capstan equation of a polygon"))


CAPSTAN = Map(
    name="capstan",
    title="How much a rope over a ball holds by friction",
    scene="capstan",
    x=Axis("coefficient of friction", (0.1, 0.2, 0.3, 0.5, 0.8)),
    y=Axis(
        "ratio of loads over e^(\N{GREEK SMALL LETTER MU}\N{GREEK SMALL LETTER PI})",
        (0.6, 0.8, 0.9, 0.97, 0.99, 1.01, 1.03, 1.1, 1.3),
    ),
    panels={
        "direct, 4 steps a frame": _capstan(Direct(), 4),
        "gauss-seidel, 64 steps of 1": _capstan(GaussSeidel(1), 64),
        "jacobi, 4 steps of 20": _capstan(Jacobi(20), 4),
    },
    text="60 links of 0.01 kg over a ball, 1 kg at one end. Off: an end has moved by more than 1 % of the scene in a "
    "second. Newton's method, which takes friction as Coulomb's law has it, holds below the capstan equation and "
    "slides above it; sweeps stop while the rope still creeps or stretches.",
)


def _short_link(method: Method, dtype: str) -> Panel:
    def cell(ratio: float, steps: float) -> Figures:
        scene = stepped(study("short_link", ratio=ratio), steps).changed(method=method)
        return run_scene(scene, dtype, energy=False, error=lambda sim: measure(sim).max_stretch)

    return Panel(cell)


SHORT_LINK = Map(
    name="short_link",
    title="One link far shorter than the others",
    scene="short_link",
    x=Axis("its length over theirs", tuple(10.0**k for k in range(-7, 1)), log=True),
    y=Axis(STEPS_A_FRAME, (1, 4, 16), log=True),
    panels={
        "direct, float32": _short_link(Direct(), "float32"),
        "direct, float64": _short_link(Direct(), "float64"),
        "gauss-seidel (20), float32": _short_link(GaussSeidel(20), "float32"),
        "gauss-seidel (20), float64": _short_link(GaussSeidel(20), "float64"),
    },
    text="A chain of links of 0.1 m, the first one shorter, swings for a second. Off: a link is more than 1 % off at "
    "the end. A short link is a stiff one: sweeps that leave a tenth of a millimetre leave a multiple of its length. "
    "Newton's method solves for all at once, and computes in float64 whatever precision the state has.",
)


def _graph(scene: Callable[[int], Scene]) -> Panel:
    def cell(links: float, steps: float) -> Figures:
        return run_scene(stepped(scene(int(links)), steps).changed(frames=60))

    return Panel(cell)


def _side(links: int) -> int:
    """Of a net of about so many links: 2 k (k - 1) of k x k particles."""
    return max(2, round(np.sqrt(links / 2.0) + 0.5))


LOOPS = Map(
    name="loops",
    title="Iterations of Newton's method on closed and taut graphs",
    scene="net",
    x=Axis("links, about", (12, 24, 60, 180, 480), log=True),
    y=Axis(STEPS_A_FRAME, (1, 2, 4, 8, 16), log=True),
    panels={
        "a loop": _graph(lambda links: study("loop", links=links)),
        "a net held by one corner": _graph(lambda links: study("net", side=_side(links), corners=1)),
        "a net taut between two": _graph(lambda links: study("net", side=_side(links), corners=2)),
    },
    text="All begin stretched out and fall for a second. The number is that of iterations a step, in the mean. The "
    "edge of a net that hangs straight between two corners has no length to give: its tension is whatever the "
    "links' stiffness makes it, so there the method gives its links some and takes it back.",
    shade="iterations",
)
