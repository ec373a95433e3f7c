"""Every remedy that a preflight check, a failed frame or the atlas names: what fails without it holds with it."""

import pytest

import pbd_warp as pbd
from pbd_warp.preflight import REMEDIES
from pbd_warp.stability.cell import run_scene, study
from pbd_warp.stability.classify import classify
from pbd_warp.stability.maps import MAPS

# By remedy: a cell (panel, x, y) of its map that fails, and cells that differ from it by what the remedy says.
CELLS = {
    "relaxation": (
        ("plain sum", 8, 1.2),
        {"averaging='mass-splitting'": ("mass splitting", 8, 1.2), "relaxation at 1": ("plain sum", 8, 1.0)},
    ),
    "star": (
        ("plain sum, on a line", 8, 1.0),
        {
            "averaging='mass-splitting'": ("mass splitting, on a line", 8, 1.0),
            "smaller relaxation": ("plain sum, on a line", 8, 0.2),
        },
    ),
    "overconstrained": (
        ("a bar, plain sum", 3, 1.0),
        {
            "averaging='mass-splitting'": ("a bar, mass splitting", 3, 1.0),
            "give each distance once": ("a bar, plain sum", 1, 1.0),
        },
    ),
    "sweeps": (
        ("mass splitting", 1, 1.5),
        {
            "an even number of iterations": ("mass splitting", 2, 1.5),
            "a relaxation of 1": ("mass splitting", 1, 1.0),
        },
    ),
    "chebyshev": (("a chain that swings", 1e-4, 128), {"a smaller rho": ("a chain that swings", 0.1, 128)}),
    "chain_length": (
        ("jacobi, iterations", 50, 16),
        {
            "Direct": ("direct, iterations", 50, 16),
            "more substeps": ("jacobi, steps of 1 iteration", 50, 128),
        },
    ),
    "mass_ratio": (
        ("gauss-seidel, iterations", 100, 64),
        {
            "Direct": ("direct, iterations", 100, 64),
            "more substeps": ("gauss-seidel, steps of 1 iteration", 100, 256),
        },
    ),
    "sweep_energy": (
        ("gauss-seidel, midpoint, 16 steps", 20, 1),
        {"5 iterations": ("gauss-seidel, midpoint, 16 steps", 20, 5)},
    ),
    "step": (
        ("gauss-seidel (20), midpoint4", 20, 15),
        {"more substeps": ("gauss-seidel (20), midpoint4", 20, 120), "'bdf2'": ("direct, bdf2", 20, 15)},
    ),
    "precision": (
        ("displacements, float32", 1e5, 960),
        {"float64": ("displacements, float64", 1e5, 960), "to the origin": ("displacements, float32", 1.0, 960)},
    ),
    "drag": (
        ("gauss-seidel, 1 iteration", 10, 4),
        {"Direct": ("direct", 10, 4), "more substeps": ("gauss-seidel, 1 iteration", 10, 64)},
    ),
    "speed": (
        ("swept contacts, float32", 3e5, 1),
        {"more substeps": ("swept contacts, float32", 3e5, 16), "float64": ("swept contacts, float64", 3e5, 1)},
    ),
    "overlap": (("16 discs", 0.5, 4), {"without overlap": ("16 discs", 0.01, 4)}),
    "unreachable": (("direct", 1.2, 64), {"nearer to each other": ("direct", 1.0, 64)}),
    "cradle": (("jacobi, balls touch", 5, 4), {"gaps wider": ("jacobi, gaps of 20 mm", 5, 4)}),
    "coincident": (("a chain, jacobi", 32, 1), {"more iterations": ("a chain, jacobi", 32, 64)}),
    "capstan": (("gauss-seidel, 64 steps of 1", 0.3, 0.6), {"Direct": ("direct, 4 steps a frame", 0.3, 0.6)}),
    "bending": (
        ("gauss-seidel (20)", 1.0, 1),
        {"Direct": ("direct", 1.0, 1), "more substeps": ("gauss-seidel (20)", 1.0, 64)},
    ),
    "short_link": (
        ("gauss-seidel (20), float64", 1e-4, 4),
        {"Direct": ("direct, float64", 1e-4, 4), "float32 too": ("direct, float32", 1e-4, 4)},
    ),
}


def outcome(name, panel, x, y):
    return classify(MAPS[name].panels[panel].cell(float(x), float(y)))


@pytest.mark.parametrize("name", CELLS)
def test_it_fails_without_and_holds_with(name):
    fails, cures = CELLS[name]
    assert outcome(name, *fails) != "converged"
    for remedy, cell in cures.items():
        assert outcome(name, *cell) == "converged", remedy


def test_direct_and_a_compliance_help_too():
    swinging = study("whip", links=32).changed(frames=40, integrator="pbd")
    assert classify(run_scene(swinging.changed(method=pbd.Jacobi(128, chebyshev=0.9999)))) != "converged"
    assert classify(run_scene(swinging.changed(method="direct"))) == "converged"
    assert classify(run_scene(study("star", spokes=8, shape="line").changed(method="gauss-seidel"))) == "converged"
    limited = study("deep_overlap").changed(depenetration_speed=0.5)
    assert classify(run_scene(limited)) == "converged"


def test_every_remedy_is_tried():
    assert {*CELLS, "loops"} == set(REMEDIES) == set(MAPS)
