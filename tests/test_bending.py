"""What is known of rods that bend, with Direct: statics, buckling, vibration, rods that other codes find stiff."""

import numpy as np
import pytest
from rods import G, at_rest, cantilever, orders, rod
from scipy.integrate import solve_bvp

import pbd_warp as pbd
from pbd_warp.accuracy import rods

LINKS = (10, 20, 40)


@pytest.mark.parametrize("load", [{"tip": 3e-3}, {"weight": 8e-3}])
def test_small_deflections_are_those_of_a_beam(load):
    """F L^3 / 3 B, w L^4 / 8 B: 0.2 % at 20 links, of order 2."""
    exact = load.get("tip", 0.0) / 3.0 + load.get("weight", 1e-4 * load.get("tip", 0.0)) / 8.0
    errors = np.array([-at_rest(cantilever(n, **load)).positions[-1, 1] / exact - 1.0 for n in LINKS])
    assert abs(errors[1]) < 2e-3
    assert np.all(orders(errors) > 1.9)


def test_a_rod_bent_far_is_euler_s_elastica():
    """The tip sinks by 0.6 of the length: it is there within 0.2 % of the length at 20 links, of order 2."""
    tip = 3.0
    errors = []
    for links in LINKS:
        s = rods.clamped(links, 1.0)
        exact = rods.elastica(s, 1.0, 1.0, (0.0, -tip), (0.0, -1e-4 * tip))
        errors.append(np.linalg.norm(at_rest(cantilever(links, tip=tip)).positions[-1] - exact[-1]))
    assert -0.65 < exact[-1, 1] < -0.55
    assert errors[1] < 2e-3
    assert np.all(orders(np.array(errors)) > 1.9)


@pytest.mark.parametrize("ends", ["clamped and free", "pinned"])
def test_a_column_buckles_at_euler_s_load(ends):
    """pi^2 B / (4 L^2), pi^2 B / L^2: 2 % below it straightens, 2 % above it bends, both slowly."""
    for load, buckles in (0.98, False), (1.02, True):
        if ends == "pinned":
            # Half of it, from the middle, where it is clamped by symmetry, to an end.
            length, euler = 0.5, np.pi**2
        else:
            length, euler = 1.0, np.pi**2 / 4.0
        s = rods.clamped(40, length)
        mass = np.full(41, 1e-5)
        mass[-1] = load * euler / G
        x = np.stack([2e-3 * np.maximum(s, 0.0) ** 2, s, 0.0 * s], axis=1)
        sim = pbd.Simulation(rod(x, mass, 1.0, rest_length=s[1] - s[0]), method=pbd.Direct(), dt=2.0)
        for _ in range(400):
            sim.step()
        aside = np.hypot(*sim.positions[-1, [0, 2]]) / length
        assert (aside > 0.1) if buckles else (aside < 1e-3 * length), (load, aside)


def test_a_ring_stays_a_circle_of_the_energy_of_its_curvature():
    """Straight at rest, closed: B / 2 times its length times 1 / R^2 is pi B / R."""
    radius, bending, energies = 0.2, 0.03, []
    for links in LINKS:
        at = 2.0 * np.pi * np.arange(links) / links
        chord = 2.0 * radius * np.sin(np.pi / links)
        builder = pbd.ModelBuilder(gravity=(0, 0, 0))
        ring = builder.add_particles(radius * np.stack([np.cos(at), np.sin(at), 0 * at], axis=1), mass=0.1 / links)
        builder.add_distances([(k, (k + 1) % links) for k in ring])
        builder.add_bendings([(k, (k + 1) % links, (k + 2) % links) for k in ring], bending)
        sim = pbd.Simulation(builder.finalize(dtype="float64"), method=pbd.Direct(), integrator="midpoint", substeps=4)
        for _ in range(30):
            sim.step()
        np.testing.assert_allclose(np.linalg.norm(sim.positions, axis=1), radius, rtol=1e-10)
        measures = pbd.measure(sim)
        np.testing.assert_allclose(measures.max_curvature, 2.0 * np.tan(np.pi / links) / chord, rtol=1e-9)
        energies.append(measures.bending)
    errors = np.array(energies) / (np.pi * bending / radius) - 1.0
    assert np.all(orders(errors) > 1.9)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_a_clamped_rod_vibrates_at_its_frequencies(number):
    """The first three of 50 links, from its shape at rest: its bending is softer by (b a)^2 / 12, b the wave number and
    a the link (second differences), which is below 0.2 % of the first two, and 0.21 % of the third."""
    links, bending, per_length = 50, 1.0, 0.1
    s = rods.clamped(links, 1.0)
    omega = rods.frequencies(number + 1, 1.0, bending, per_length)[number]
    shape = np.where(s > 0.0, rods.mode(np.maximum(s, 0.0), number, 1.0), 0.0)
    shape[1] = 0.0
    mass = np.full(links + 1, per_length * (s[1] - s[0]))
    mass[-1] *= 0.5
    x = np.stack([s, 1e-5 * shape, 0.0 * s], axis=1)
    steps = 80
    sim = pbd.Simulation(
        rod(x, mass, bending, gravity=(0, 0, 0)),
        method=pbd.Direct(), integrator="midpoint4", dt=2.0 * np.pi / omega / steps,
    )  # fmt: skip
    weight = mass * shape
    aside = []
    for _ in range(steps + steps // 4 + 2):
        aside.append(weight @ sim.positions[:, 1])
        sim.step()
    at = np.arange(len(aside))
    # Where it passes through 0 for the third time: after 5/4 of a period.
    last = [k for k in at[:-1] if aside[k] * aside[k + 1] <= 0.0][2]
    root = last + aside[last] / (aside[last] - aside[last + 1])
    wave = np.sqrt(rods.frequencies(number + 1, 1.0, 1.0, 1.0)[number]) * (s[1] - s[0])
    assert root / (1.25 * steps) - 1.0 == pytest.approx(wave**2 / 12.0, abs=2e-4)
    assert wave**2 / 12.0 < (2e-3 if number < 2 else 2.2e-3)


def test_a_stiff_pendulum_swings_as_its_equation_says():
    """(B u'')'' - (T u')' = rho A omega^2 u, T = rho A g (L - s), hung freely: its slowest swing, against SciPy."""
    bending, links = 0.02, 40

    def rate(s, y, p):  # u, u', B u'', (B u'')' - T u'
        return np.vstack([y[1], y[2] / bending, y[3] + G * (1.0 - s) * y[1], p[0] * y[0]])

    s = np.linspace(0.0, 1.0, 101)
    start = np.vstack([s, 0 * s + 1.0, 0 * s, -G * (1 - s)])
    found = solve_bvp(
        rate, lambda a, b, p: [a[0], a[2], b[2], b[3], a[1] - 1.0], s, start, p=[1.4 * G], tol=1e-9, max_nodes=20000
    )
    assert found.success
    omega = np.sqrt(found.p[0])
    along = np.arange(links + 1) / links
    x = np.stack([1e-5 * found.sol(along)[0], -along, 0.0 * along], axis=1)
    sim = pbd.Simulation(
        rod(x, 1.0, bending, pinned=(0,)), method=pbd.Direct(), integrator="midpoint4", dt=2.0 * np.pi / omega / 80
    )
    aside = [x[-1, 0]]
    for _ in range(64):
        sim.step()
        aside.append(sim.positions[-1, 0])
    last = [k for k in range(64) if aside[k] * aside[k + 1] <= 0.0][1]
    root = last + aside[last] / (aside[last] - aside[last + 1])
    assert root / 80 == pytest.approx(0.75, rel=1e-3)


def test_a_taut_cable_bends_at_its_clamps_over_its_boundary_layer():
    """Tension H, clamped at an angle: u' = angle exp(-s sqrt(H / B)), so the tip moves by angle sqrt(B / H)."""
    bending, tension, angle = 0.01, 4.0, 1e-3
    offsets = []
    for links in (40, 80):
        s = rods.clamped(links, 1.0)
        along = np.array([np.cos(angle), np.sin(angle), 0.0])
        mass = np.full(links + 1, 1e-5)
        mass[-1] = tension / G
        x = np.stack([0.0 * s, -s, 0.0 * s], axis=1)
        x[:2] = s[:2, None] * np.array([along[1], -along[0], 0.0])
        sim = at_rest(rod(x, mass, bending), frames=60)
        offsets.append(sim.positions[-1, 0] / angle)
    errors = np.array(offsets) / np.sqrt(bending / tension) - 1.0
    assert abs(errors[1]) < 1e-2
    assert orders(errors) > 1.8


STIFF = {"suture": (2e-4, 750e6, 1100.0), "steel": (5e-3, 50e9, 7800.0)}


@pytest.mark.parametrize("substeps", [1, 4])
@pytest.mark.parametrize("name", STIFF)
def test_stiff_rods_never_fail_at_60_hz(name, substeps):
    """50 links of a metre fall from the horizontal, clamped and pinned: at most 5 Newton iterations in the mean."""
    section = pbd.RoundSection(*STIFF[name])
    for pinned in ((0, 1), (0,)):
        builder = pbd.ModelBuilder()
        builder.add_rope(np.linspace([0.0, 0, 0], [1, 0, 0], 51), pinned=pinned, section=section)
        sim = pbd.Simulation(builder.finalize(dtype="float64"), method=pbd.Direct(), substeps=substeps)
        used = 0
        for _ in range(60):
            sim.step()
            assert sim.unconverged == 0
            used += sim.iterations_used
        assert used / (60 * substeps) <= 5.0


@pytest.mark.parametrize("bending", 10.0 ** np.arange(-7, 3))
def test_nine_orders_of_magnitude_of_stiffness(bending):
    """A metre of 0.1 kg falls from a clamp for half a second; in single precision too."""
    for dtype in ("float64", "float32"):
        x = np.linspace([0.0, 0, 0], [1, 0, 0], 21)
        sim = pbd.Simulation(rod(x, 0.1, bending, dtype=dtype), method=pbd.Direct(), substeps=2)
        for _ in range(30):
            sim.step()
        assert np.isfinite(sim.positions).all()
        assert pbd.measure(sim).max_stretch < (1e-6 if dtype == "float64" else 1e-5)
