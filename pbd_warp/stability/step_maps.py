"""Maps of the step: its length, its integrator, its precision."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from pbd_warp.model.builder import ModelBuilder
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.stability import theory
from pbd_warp.stability.cell import STEPS_A_FRAME, run_scene, stepped, study
from pbd_warp.stability.classify import OFF, Figures
from pbd_warp.stability.map import Axis, Boundary, Map, Panel
from pbd_warp.step.methods import Direct, GaussSeidel, Jacobi, Method


def _whip(method: Method, integrator: str) -> Panel:
    def cell(x: float, y: float) -> Figures:
        scene = study("whip", links=int(x), fps=y)
        return run_scene(scene.changed(frames=int(y), method=method, integrator=integrator))

    return Panel(cell)


STEP = Map(
    name="step",
    title="How long a step each integrator takes through the crack of a whip",
    scene="whip",
    x=Axis("links", (5, 10, 20, 50, 100, 200), log=True),
    y=Axis("steps a second", (5, 10, 15, 20, 30, 60, 120, 240), log=True),
    panels={
        "direct, pbd": _whip(Direct(), "pbd"),
        "direct, bdf2": _whip(Direct(), "bdf2"),
        "gauss-seidel (20), bdf2": _whip(GaussSeidel(20), "bdf2"),
        "direct, midpoint": _whip(Direct(), "midpoint"),
        "direct, midpoint4": _whip(Direct(), "midpoint4"),
        "gauss-seidel (20), midpoint4": _whip(GaussSeidel(20), "midpoint4"),
    },
    text="A chain of 1 m falls from the horizontal and cracks, for a second. Where a step is too long for the "
    "crack, Newton's method does not find the balance that the midpoint rule asks for, and what it leaves "
    "is stretch or energy; which of the long steps that hits is chance. 'bdf2' and 'pbd' hold in all but "
    "the longest step of the longest chain, and take energy away.",
)


def _swings_long(method: type, integrator: str) -> Panel:
    def cell(x: float, y: float) -> Figures:
        scene = study("whip", links=int(x)).changed(frames=600, method=method(int(y)), integrator=integrator)
        return run_scene(stepped(scene, 16 if integrator == "midpoint" else 4))

    return Panel(cell)


SWEEP_ENERGY = Map(
    name="sweep_energy",
    title="How many sweeps an integrator needs that keeps energy",
    scene="whip",
    x=Axis("links", (3, 6, 10, 20, 30, 60), log=True),
    y=Axis("iterations a step", (1, 2, 3, 4, 5, 8, 16)),
    panels={
        "gauss-seidel, midpoint, 16 steps": _swings_long(GaussSeidel, "midpoint"),
        "gauss-seidel, midpoint4, 4 steps": _swings_long(GaussSeidel, "midpoint4"),
        "jacobi, midpoint, 16 steps": _swings_long(Jacobi, "midpoint"),
    },
    text="A chain of 1 m swings for 10 s. A sweep of Gauss-Seidel treats the two ends of a link unlike: what a few of "
    "them leave over does work, which nothing takes away again, and after seconds the chain flies apart. Jacobi's "
    "sweeps are symmetric; they leave the chain stretched, but bring no energy in.",
)

LENGTH = 1.0
"""Of the pendulum far away [m]; errors are over it."""


def _swung(distance: float, rate: float, dtype: str) -> tuple[Figures, np.ndarray]:
    """The pendulum at a distance after a second, and where its bob is from the pin [m]."""
    found: list[np.ndarray] = []

    def note(sim: Simulation) -> float:
        found.append(np.diff(sim.state.x.numpy().astype(np.float64), axis=0)[0])
        return float("nan")

    scene = stepped(study("far_away", distance=distance), rate / 60.0).changed(frames=60)
    return run_scene(scene, dtype, energy=False, error=note), found[0]


@cache
def _at_origin(rate: float) -> np.ndarray:
    return _swung(0.0, rate, "float64")[1]


def _pendulum(dtype: str) -> Callable[[float, float], Figures]:
    """A cell: the pendulum at a distance x in y steps a second, against the same steps at the origin."""

    def cell(x: float, y: float) -> Figures:
        figures, bob = _swung(x, y, dtype)
        return replace(figures, error=float(np.abs(bob - _at_origin(y)).max()) / LENGTH)

    return cell


def textbook_pendulum(distance: float, rate: int, dtype: Any) -> np.ndarray:
    """Where the bob of the scene far_away is after a second, from the pin, with the textbook's v = (p - x)/h [m]."""
    h, pin = dtype(1.0 / rate), np.array([distance, distance], dtype)
    x = pin + np.array([LENGTH, 0.0], dtype)
    v, fall = np.zeros(2, dtype), np.array([0.0, -theory.GRAVITY * h], dtype)
    for _ in range(rate):
        v = v + fall
        rod = (x + h * v) - pin
        p = pin + rod * (dtype(LENGTH) / dtype(np.linalg.norm(rod)))
        v, x = (p - x) / h, p
    return (x - pin).astype(np.float64)


def _textbook(x: float, y: float) -> Figures:
    exact = textbook_pendulum(0.0, int(y), np.float64)
    with np.errstate(all="ignore"):  # where the rod has no length left
        at = textbook_pendulum(x, int(y), np.float32)
    finite = bool(np.isfinite(at).all())
    return Figures(finite=finite, error=float(np.abs(at - exact).max()) / LENGTH if finite else float("nan"))


PRECISION = Map(
    name="precision",
    title="How far from the origin, and in how short steps",
    scene="far_away",
    x=Axis("distance from the origin [m]", tuple(10.0**k for k in range(9)), log=True),
    y=Axis("steps a second", (60, 240, 960, 3840), log=True),
    panels={
        "textbook v = (p \N{MINUS SIGN} x) / h, float32 (NumPy)": Panel(
            _textbook, Boundary(lambda x: theory.textbook_rate(x, OFF * LENGTH), "random walk of v, off by 1 %")
        ),
        "displacements, float32": Panel(
            _pendulum("float32"),
            Boundary(lambda x: theory.displacement_rate(x, OFF * LENGTH), "random walk of x, off by 1 %"),
        ),
        "displacements, float64": Panel(_pendulum("float64")),
    },
    text="A pendulum of 1 m swings for a second, against the same steps in float64 at the origin. Positions "
    "far away have few digits in float32, and velocities taken from them fewer, the shorter the step. "
    "With displacements as the unknown only the stored position is rounded.",
)


def _dragged(method: Method) -> Panel:
    """A cell: a rope of 10 links taken by its head and led away along its own line at x m/s, in y steps a frame."""

    def cell(x: float, y: float) -> Figures:
        builder = ModelBuilder(gravity=(0, 0, 0))
        rope = builder.add_rope(np.linspace([0.0, 0, 0], [-1.0, 0, 0], 11), mass=0.5, pinned=())
        drag = [(0.0, "select", rope[0]), (0.5, "move", (0.5 * x, 0.0, 0.0))]
        scene = stepped(Scene(builder, frames=30, method=method, drag=drag), y)
        return run_scene(scene, energy=False)

    return Panel(cell)


DRAG = Map(
    name="drag",
    title="How fast a rope can be led by its head",
    scene="worm",
    x=Axis("speed of the grabber [m/s]", (0.1, 0.3, 1, 3, 10, 30, 100, 300), log=True),
    y=Axis(STEPS_A_FRAME, (1, 2, 4, 8, 16, 32, 64), log=True),
    panels={
        "jacobi, 1 iteration": _dragged(Jacobi(1)),
        "gauss-seidel, 1 iteration": _dragged(GaussSeidel(1)),
        "gauss-seidel, 16 iterations": _dragged(GaussSeidel(16)),
        "direct": _dragged(Direct()),
    },
    text="A straight rope of 10 links at rest is taken by its head and led away, for half a second. The jerk "
    "of the first step has to reach the tail before the links are 10 % too long.",
)
