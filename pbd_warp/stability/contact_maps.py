"""Maps of contacts, and of constraints that start or stay violated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pbd_warp.simulation import Simulation
from pbd_warp.stability import theory
from pbd_warp.stability.cell import STEPS_A_FRAME, run_scene, stepped, study
from pbd_warp.stability.classify import Figures
from pbd_warp.stability.map import Axis, Boundary, Map, Panel
from pbd_warp.step.divergence import STRETCHED
from pbd_warp.step.methods import Direct, GaussSeidel, Jacobi

DIAMETER = 0.1
"""r1 + r2 of a bullet and a post [m]."""

MISSED = frozenset({"missed"})


def _bullets(dtype: str) -> Callable[[float, float], Figures]:
    def cell(x: float, y: float) -> Figures:
        return run_scene(stepped(study("bullet", speed=x), y).changed(frames=4), dtype, in_line=True)

    return cell


def sampled_bullets(speed: float, steps: int) -> bool:
    """Whether a bullet of the scene gets past its post where overlap is tested at the ends of steps alone."""
    builder = study("bullet", speed=speed).builder
    model = builder.finalize(dtype="float64")
    moving = model.v[:, 0] > 0.0
    step = speed / (60.0 * steps)
    for start in model.x[moving, 0]:
        reached = start + step * np.arange(1, int(-start / step) + 3)  # until past the post at 0
        if not np.any(np.abs(reached) < DIAMETER):
            return True
    return False


def _sampled(x: float, y: float) -> Figures:
    return Figures(missed=sampled_bullets(x, int(y)))


SPEED = Map(
    name="speed",
    title="How fast a bullet is stopped",
    scene="bullet",
    x=Axis("speed [m/s]", (3, 10, 30, 100, 300, 1e3, 3e3, 1e4, 3e4, 1e5, 3e5), log=True),
    y=Axis(STEPS_A_FRAME, (1, 2, 4, 8, 16), log=True),
    panels={
        "overlap at the ends of steps (NumPy)": Panel(
            _sampled,
            Boundary(
                lambda y: theory.sampled_speed(60.0 * y, DIAMETER), "2 (r1 + r2) a step", along="y", outcomes=MISSED
            ),
        ),
        "swept contacts, float32": Panel(
            _bullets("float32"),
            Boundary(
                lambda y: theory.swept_speed(60.0 * y, DIAMETER, float(np.finfo(np.float32).epsneg)),
                "(r1 + r2) / \N{SQUARE ROOT}\N{GREEK SMALL LETTER EPSILON} a step",
                along="y",
                outcomes=MISSED,
            ),
        ),
        "swept contacts, float64": Panel(_bullets("float64")),
    },
    text="8 bullets of 5 cm radius fly at posts of the same size, from places spread over a frame's way. A "
    "test for overlap at the ends of the steps lets some through as soon as a step is longer than both "
    "diameters. The swept test stops all, up to where float32 has no digits left for it: some 4000 "
    "diameters a step.",
)


def _heap(discs: int, method: type) -> Callable[[float, float], Figures]:
    def cell(x: float, y: float) -> Figures:
        scene = study("deep_overlap", depth=x, discs=discs)
        return run_scene(stepped(scene, y).changed(frames=12, method=method(8)))

    return cell


OVERLAP = Map(
    name="overlap",
    title="How deep discs may start inside each other",
    scene="deep_overlap",
    x=Axis("depth over the diameter", (0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.9), log=True),
    y=Axis(STEPS_A_FRAME, (1, 2, 4, 8, 16), log=True),
    panels={
        "2 discs": Panel(_heap(2, Jacobi)),
        "3 discs": Panel(
            _heap(3, Jacobi),
            Boundary(lambda x: theory.overlap_rate(x, 0.1) / 60.0, "a quarter of depth / step is left"),
        ),
        "16 discs": Panel(_heap(16, Jacobi)),
    },
    text="Discs pressed into each other are let go. The projection parts them in one step, which is a velocity "
    "of depth over step. Line 16 stops a pair entirely; of three discs with each other it leaves a "
    "quarter, of a heap more.",
)


LINKS = 10
"""Of the rope that is held."""


def _held(method: type) -> Callable[[float, float], Figures]:
    def cell(x: float, y: float) -> Figures:
        scene = study("stretched", factor=x, links=LINKS)
        return run_scene(stepped(scene, 2).changed(frames=60, damping=0.0, method=method(int(y))), energy=False)

    return cell


UNREACHABLE = Map(
    name="unreachable",
    title="A rope held further apart than its length",
    scene="stretched",
    x=Axis("distance of the ends over the length", (1.0, 1.005, 1.01, 1.02, 1.05, 1.08, 1.12, 1.2, 1.5, 2.0, 3.0)),
    y=Axis("iterations", (1, 4, 16, 64), log=True),
    panels={
        "jacobi": Panel(
            _held(Jacobi),
            Boundary(
                lambda y: 1.0 + STRETCHED * (LINKS - 1) / LINKS,
                "1.09: spread over all links, half at the ends",
                along="y",
            ),
        ),
        "gauss-seidel": Panel(_held(GaussSeidel)),
        "direct": Panel(
            _held(Direct), Boundary(lambda y: 1.0 + STRETCHED, "1.1: spread over all links alike", along="y")
        ),
    },
    text="A rope of 10 links is pulled by its end, and held. No positions satisfy the lengths: Jacobi spreads "
    "what is too much over all links, Gauss-Seidel leaves more of it to some. Direct gives all links the same share, "
    "as an elastic rope would, from some 20 iterations on.",
)


def _cradle(method: type, gap: float) -> Callable[[float, float], Figures]:
    def cell(x: float, y: float) -> Figures:
        def wrong(sim: Simulation) -> float:
            """Velocities against those of the exact cradle, the last ball's 1 m/s and the others' 0."""
            v = sim.state.v.numpy()[:, 0].astype(np.float64)
            return float(np.abs(v - np.eye(len(v))[-1]).max())

        scene = study("cradle", balls=int(x), gap=gap).changed(method=method(int(y)), frames=45)
        return run_scene(scene, in_line=True, error=wrong)

    return cell


CRADLE = Map(
    name="cradle",
    title="Newton's cradle",
    scene="cradle",
    x=Axis("balls", (2, 3, 4, 5, 6, 8)),
    y=Axis("iterations", (1, 2, 4, 16), log=True),
    panels={
        "jacobi, balls touch": Panel(_cradle(Jacobi, 0.0)),
        "jacobi, gaps of 1 mm": Panel(_cradle(Jacobi, 0.001)),
        "jacobi, gaps of 20 mm": Panel(_cradle(Jacobi, 0.02)),
        "gauss-seidel, balls touch": Panel(_cradle(GaussSeidel, 0.0)),
        "gauss-seidel, gaps of 1 mm": Panel(_cradle(GaussSeidel, 0.001)),
        "gauss-seidel, gaps of 20 mm": Panel(_cradle(GaussSeidel, 0.02)),
    },
    text="A ball at 1 m/s hits a row of balls with restitution 1, 240 steps a second. The exact outcome, the "
    "last ball alone flies off, comes where one collision is over before the next begins; balls that "
    "touch share one pass of line 16, and several fly off. The two methods treat contacts alike, and "
    "Direct has no distances here to solve.",
)


def _coincident(method: type, joined: int) -> Callable[[float, float], Figures]:
    def cell(x: float, y: float) -> Figures:
        scene = study("coincident", count=int(x), joined=joined)
        return run_scene(scene.changed(frames=30, method=method(int(y))), energy=False)

    return cell


COINCIDENT = Map(
    name="coincident",
    title="All particles in one place",
    scene="coincident",
    x=Axis("particles", (2, 3, 4, 6, 8, 12, 16, 32), log=True),
    y=Axis("iterations", (1, 2, 4, 16, 64), log=True),
    panels={
        "a chain, jacobi": Panel(_coincident(Jacobi, 1)),
        "a chain, gauss-seidel": Panel(_coincident(GaussSeidel, 1)),
        "a chain, direct": Panel(_coincident(Direct, 1)),
        "discs, jacobi": Panel(_coincident(Jacobi, 0)),
    },
    text="Pairs of no distance have no direction to part along; the x axis stands in for it. Nothing becomes "
    "not a number, and all unfold within half a second, given a few iterations.",
)
