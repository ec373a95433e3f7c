"""Maps of the iteration: where sweeps over the constraints converge, and how many it takes."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from pbd_warp.model.builder import ModelBuilder
from pbd_warp.scene import Scene, references
from pbd_warp.stability import theory
from pbd_warp.stability.cell import run_scene, stepped, study
from pbd_warp.stability.classify import Figures
from pbd_warp.stability.map import Axis, Boundary, Map, Panel
from pbd_warp.step.methods import Direct, GaussSeidel, Jacobi
from pbd_warp.step.methods.jacobi import spectral_radius

SWEEPS = 20
"""A step, where the map does not vary it; even, see theory.sweeps_limit."""

FRAMES = 10
"""Enough for the error to show where it goes: 200 sweeps."""

RELAXATION = Axis("relaxation", tuple(round(0.1 * k, 1) for k in range(2, 23)))
REFUSED = Boundary(lambda x: 2.0, "relaxation 2, on every graph")
WORK = (1, 2, 4, 8, 16, 32, 64, 128, 256)


def alternating_chain(links: int) -> Scene:
    """The chain of the scene, free and without gravity, its links too long and too short in turn, by 1 %."""
    length = (1.0 + 0.01 * (-1.0) ** np.arange(links)) / links
    x = np.r_[0.0, np.cumsum(length)]
    builder = ModelBuilder(gravity=(0, 0, 0))
    chain = builder.add_particles(np.stack([x, 0 * x, 0 * x], axis=1), mass=1.0)
    builder.add_distances([(i, i + 1) for i in chain[:-1]], rest_length=1.0 / links)
    return Scene(builder, frames=FRAMES)


def _relaxed(scene: Callable[[int], Scene], averaging: str) -> Callable[[float, float], Figures]:
    """A cell: a scene made from x, relaxation y."""

    def cell(x: float, y: float) -> Figures:
        method = Jacobi(SWEEPS, relaxation=y, averaging=averaging)
        return run_scene(scene(int(x)).changed(frames=FRAMES, method=method))

    return cell


RELAXED = Map(
    name="relaxation",
    title="A chain, and the relaxation of Jacobi's sweeps",
    scene="chain",
    x=Axis("links", (1, 2, 3, 4, 6, 8, 12, 16, 32), log=True),
    y=RELAXATION,
    panels={
        "plain sum": Panel(
            _relaxed(alternating_chain, "none"),
            Boundary(theory.chain_limit, "2 / (1 + cos(\N{GREEK SMALL LETTER PI} / (links + 1)))"),
        ),
        "valence": Panel(_relaxed(alternating_chain, "valence"), Boundary(lambda x: 2.0, "2")),
        "mass splitting": Panel(_relaxed(alternating_chain, "mass-splitting"), REFUSED),
    },
    text="A free straight chain without gravity, its links 1 % too long and too short in turn. Summed, the "
    "corrections of the two links at a particle overshoot as soon as the relaxation passes 1; averaged or "
    "with split masses the limit is 2, and beyond that mass splitting refuses.",
)


def _star(shape: str, averaging: str) -> Callable[[float, float], Figures]:
    return _relaxed(lambda spokes: study("star", spokes=spokes, shape=shape), averaging)


STAR = Map(
    name="star",
    title="A star, and the relaxation of Jacobi's sweeps",
    scene="star",
    x=Axis("spokes", (3, 4, 5, 6, 7, 8, 9, 10, 12, 14, 16, 20)),
    y=RELAXATION,
    panels={
        "plain sum, in the plane": Panel(
            _star("planar", "none"), Boundary(lambda d: theory.star_limit(d, "planar"), "4 / (1 + spokes / 2)")
        ),
        "plain sum, in space": Panel(
            _star("space", "none"), Boundary(lambda d: theory.star_limit(d, "space"), "4 / (1 + spokes / 3)")
        ),
        "plain sum, on a line": Panel(
            _star("line", "none"), Boundary(lambda d: theory.star_limit(d, "line"), "4 / (1 + spokes)")
        ),
        "mass splitting, on a line": Panel(_star("line", "mass-splitting"), REFUSED),
    },
    text="Equal masses, the hub 3 % off the middle. With the plain sum the spokes move the hub further than it "
    "is off: at relaxation 1 from 7 spokes on in the plane, 10 in space, 4 on a line. With split masses "
    "every star converges.",
)


def _copies(sides: int, averaging: str) -> Callable[[float, float], Figures]:
    return _relaxed(lambda copies: study("overconstrained", copies=copies, sides=sides, misfit=0.0), averaging)


OVERCONSTRAINED = Map(
    name="overconstrained",
    title="Distances given several times, and the relaxation of Jacobi's sweeps",
    scene="overconstrained",
    x=Axis("copies of each distance", (1, 2, 3, 4, 5, 6, 8)),
    y=RELAXATION,
    panels={
        "a bar, plain sum": Panel(_copies(1, "none"), Boundary(theory.bar_limit, "2 / copies")),
        "a triangle, plain sum": Panel(_copies(3, "none"), Boundary(theory.triangle_limit, "4 / (3 copies)")),
        "a bar, mass splitting": Panel(_copies(1, "mass-splitting"), REFUSED),
        "a triangle, mass splitting": Panel(_copies(3, "mass-splitting"), REFUSED),
    },
    text="A bar or a triangle, 3 % too large, each side given several times. With the plain sum every copy "
    "takes the whole error away: a bar given twice never converges at relaxation 1, given three times it "
    "flies apart.",
)


def _odd_and_even(averaging: str, links: int) -> Callable[[float, float], Figures]:
    def cell(x: float, y: float) -> Figures:
        scene = alternating_chain(links)
        frames = max(FRAMES, round(FRAMES * SWEEPS / x))
        return run_scene(scene.changed(frames=frames, method=Jacobi(int(x), relaxation=y, averaging=averaging)))

    return cell


SWEEP_NUMBER = Map(
    name="sweeps",
    title="Over-relaxation, and an odd number of sweeps a step",
    scene="chain",
    x=Axis("iterations a step", (1, 2, 3, 4, 5, 6, 7, 8, 9, 10)),
    y=Axis("relaxation", tuple(round(0.8 + 0.1 * k, 1) for k in range(13))),
    panels={
        "mass splitting": Panel(
            _odd_and_even("mass-splitting", 6),
            Boundary(theory.sweeps_limit, "even: 2; odd: 1 + 3^(-1 / iterations)"),
        ),
    },
    text="A free chain of 6 links, as in the map of relaxation. What a step leaves of an error comes back with "
    "the velocity in the next, twice less what was before: where an odd number of over-relaxed sweeps "
    "turns more than a third of the error around, the run is unstable although every sweep by itself "
    "converges. One iteration takes a relaxation of 4/3 at most.",
)


def _hanging(method: str, steps: bool) -> Boundary:
    @cache
    def needed(links: float) -> float:
        return theory.sweeps_for(theory.rope_masses(links), 1.0 / 60.0, method, steps=steps)

    return Boundary(needed, "links 10 % too long at rest, by the sweep's matrix", fails="below")


def _budget(scene: Callable[[float], Scene], method: type, steps: bool) -> Callable[[float, float], Figures]:
    """A cell: a scene made from x, y sweeps a frame, either in one step or in so many."""

    def cell(x: float, y: float) -> Figures:
        made = method(1 if steps else int(y))
        return run_scene(stepped(scene(x), y if steps else 1).changed(method=made, integrator="pbd"))

    return cell


def _rope(links: float) -> Scene:
    return study("long_rope", links=int(links))


def _bob(ratio: float) -> Scene:
    return study("heavy_bob", ratio=ratio, links=20).changed(frames=60)


def _swinging(method: str, steps: bool) -> Boundary:
    @cache
    def needed(ratio: float) -> float:
        return theory.sweeps_for(theory.heavy_bob(ratio, 20), 1.0 / 60.0, method, 3.0, steps)

    return Boundary(needed, "links 10 % too long at 3 times the weight, as in a swing", fails="below")


CHAIN_LENGTH = Map(
    name="chain_length",
    title="How many links a number of sweeps can carry",
    scene="long_rope",
    x=Axis("links", (5, 10, 20, 50, 100, 200), log=True),
    y=Axis("sweeps a frame of 1/60 s", WORK, log=True),
    panels={
        "jacobi, iterations": Panel(_budget(_rope, Jacobi, False), _hanging("jacobi", False)),
        "gauss-seidel, iterations": Panel(_budget(_rope, GaussSeidel, False), _hanging("gauss-seidel", False)),
        "direct, iterations": Panel(_budget(_rope, Direct, False)),
        "jacobi, steps of 1 iteration": Panel(_budget(_rope, Jacobi, True), _hanging("jacobi", True)),
        "gauss-seidel, steps of 1 iteration": Panel(_budget(_rope, GaussSeidel, True), _hanging("gauss-seidel", True)),
    },
    text="A rope of 1 m hangs straight down for a second. A sweep carries the weight one link on: the stretch "
    "grows with the square of the number of links, falls with the iterations and with the square of the "
    "steps.",
)

MASS_RATIO = Map(
    name="mass_ratio",
    title="How heavy a bob a number of sweeps can carry",
    scene="heavy_bob",
    x=Axis("mass of the bob over that of a particle", (1, 10, 100, 1e3, 1e4, 1e5), log=True),
    y=Axis("sweeps a frame of 1/60 s", WORK, log=True),
    panels={
        "jacobi, iterations": Panel(_budget(_bob, Jacobi, False), _swinging("jacobi", False)),
        "gauss-seidel, iterations": Panel(_budget(_bob, GaussSeidel, False), _swinging("gauss-seidel", False)),
        "direct, iterations": Panel(_budget(_bob, Direct, False)),
        "jacobi, steps of 1 iteration": Panel(_budget(_bob, Jacobi, True), _swinging("jacobi", True)),
        "gauss-seidel, steps of 1 iteration": Panel(_budget(_bob, GaussSeidel, True), _swinging("gauss-seidel", True)),
    },
    text="20 links with a heavy end swing down from the horizontal, for a second. The heavier the bob, the "
    "more sweeps it takes to stop its fall through the light links.",
)


def _sagging() -> Scene:
    x = references().catenary(32, 1.0 / 32, 0.7)
    builder = ModelBuilder()
    builder.add_rope(x, mass=1.0, pinned=(0, -1))
    return Scene(builder, frames=40)


def _whip() -> Scene:
    return study("whip", links=32).changed(frames=40, integrator="pbd")


def _accelerated(scene: Callable[[], Scene]) -> Panel:
    def cell(x: float, y: float) -> Figures:
        return run_scene(scene().changed(method=Jacobi(int(y), chebyshev=1.0 - x)))

    @cache
    def gap(y: float) -> float:
        return 1.0 - spectral_radius(scene().builder.finalize(dtype="float64"), Jacobi())

    blown = frozenset({"not finite", "gained energy"})
    formula = "1 \N{MINUS SIGN} rho of the graph, as chebyshev='auto' takes it"
    return Panel(cell, Boundary(gap, formula, fails="below", along="y", outcomes=blown))


CHEBYSHEV = Map(
    name="chebyshev",
    title="Chebyshev's acceleration, and the spectral radius that it is told",
    scene="catenary",
    x=Axis("1 \N{MINUS SIGN} rho", (1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3), log=True),
    y=Axis("iterations", (32, 64, 128, 256), log=True),
    panels={"a catenary at rest": _accelerated(_sagging), "a chain that swings": _accelerated(_whip)},
    text="32 links. Told a radius closer to 1 than the sweep's own, the acceleration adds energy in every step "
    "until the chain flies apart; told a smaller one, it helps less.",
)
