"""What explicit steps are too long for is foretold, and what is foretold happens: whips, and ropes held taut."""

import numpy as np
import pytest
from explicit import explicit

import pbd_warp as pbd
from pbd_warp.errors import SimulationFailed
from pbd_warp.model.graph import links_of, lowest


def rope(links, x=None, fixed=(0,), **more):
    builder = pbd.ModelBuilder()
    if x is None:
        x = np.linspace([0.0, 0, 0], [1.0, 0, 0], links + 1)
    mass = np.full(links + 1, 1.0 / links)
    mass[list(fixed)] = 0.0
    builder.add_particles(x, np.zeros_like(x) if "v" not in more else more["v"], mass)
    builder.add_distances([(k, k + 1) for k in range(links)], 1.0 / links)
    return builder.finalize(dtype="float64")


def warned(sim):
    return [w.test for w in sim.check() if w.severity > 1.0]


def holds(sim, frames=600):
    """Whether it keeps its energy within a tenth of its weight times its length for so long."""
    start = pbd.measure(sim).energy
    try:
        for _ in range(frames):
            sim.step()
            if abs(pbd.measure(sim).energy - start) > 0.1 * 9.81:
                return False
    except SimulationFailed:
        return False
    return True


@pytest.mark.parametrize(
    ("integrator", "links", "substeps", "whip"),
    [
        ("dop853", 10, 1, True),
        ("dop853", 10, 4, False),
        ("dop853", 20, 2, True),
        ("dop853", 50, 8, True),
        ("dop853", 50, 16, False),
        ("rk4", 3, 1, False),
        ("rk4", 10, 2, True),
        ("rk4", 10, 4, False),
        ("rk4", 20, 4, True),
        ("rk4", 20, 8, False),
    ],
)
def test_whips(integrator, links, substeps, whip):
    sim = explicit(rope(links), integrator=integrator, substeps=substeps)
    assert warned(sim) == ["step"] * whip
    assert holds(sim) is not whip


def test_only_what_has_energy_cracks():
    """At rest, straight down: nothing; with the speed of a fall: as one that falls; chosen steps: nothing."""
    down = np.linspace([0.0, 0, 0], [0.0, -1.0, 0], 51)
    hanging = explicit(rope(50, down), substeps=1)
    assert not hanging.check()
    assert holds(hanging, 60)
    v = np.linspace([0.0, 0, 0], [6.0, 0, 0], 51)
    assert warned(explicit(rope(50, down, v=v), substeps=1)) == ["step"]
    assert not explicit(rope(50)).check()


def test_free_flight_is_not_motion():
    v = np.tile([100.0, 0.0, 0.0], (11, 1))
    assert not explicit(rope(10, fixed=(), v=v), substeps=1).check()
    spin = np.cross([0.0, 0.0, 30.0], np.linspace([-0.5, 0, 0], [0.5, 0, 0], 11))
    assert warned(explicit(rope(10, fixed=(), v=v + spin), substeps=1)) == ["step"]


def zigzag(slack, links=10):
    """Between two points, on its lengths."""
    x = np.linspace([0.0, 0, 0], [1.0 - slack, 0, 0], links + 1)
    x[1::2, 1] -= np.sqrt(1.0 - (1.0 - slack) ** 2) / links
    return rope(links, x, fixed=(0, links))


@pytest.mark.parametrize(
    ("slack", "settings", "taut"),
    [
        (1e-2, {"substeps": 1}, True),
        (1e-2, {"substeps": 8}, False),
        (1e-4, {"substeps": 8}, False),
        (1e-6, {"substeps": 8}, True),
        (1e-6, {"error": 1e-6}, False),
    ],
)
def test_ropes_held_taut(slack, settings, taut):
    sim = explicit(zigzag(slack), **settings)
    assert warned(sim) == ["unreachable"] * taut
    assert holds(sim, 30) is not taut


def test_steps_of_a_taut_rope_that_are_chosen_get_tiny():
    sim = explicit(zigzag(1e-13), error=1e-6)
    assert warned(sim) == ["unreachable"]
    assert "steps a frame or more" in sim.check()[0].text
    try:
        sim.step()
    except SimulationFailed:
        return  # none was short enough
    assert sim.substeps_used > 200


def test_ropes_held_too_far_are_told_once():
    builder = pbd.ModelBuilder()
    builder.add_particles([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]], mass=[0.0, 1.0, 0.0])
    builder.add_distances([(0, 1), (1, 2)], 0.49)
    sim = explicit(builder.finalize(dtype="float64"))
    (only,) = sim.check()
    assert only.text == "particles 0 and 2 are held 1 m apart, on a rope of 0.98 m"


def test_springs_that_need_many_steps_are_told_with_auto_too():
    builder = pbd.ModelBuilder()
    builder.add_particles([[0.0, 0, 0], [1.0, 0, 0]], mass=[0.0, 1.0])
    builder.add_distances([(0, 1)], 0.99, compliance=1e-12)
    assert warned(explicit(builder.finalize(dtype="float64"))) == ["step"]


def test_what_hangs_on_two_is_held_by_the_nearer():
    links = links_of(np.array([(0, 1), (1, 2), (2, 3)]), np.array([1.0, 1.0, 1.0]))
    assert lowest(links, {0: 0.0, 3: 1.5}) == {0: 0.0, 1: -0.5, 2: 0.5, 3: 1.5}
    assert lowest(links, {0: 0.0}) == {0: 0.0, 1: -1.0, 2: -2.0, 3: -3.0}
