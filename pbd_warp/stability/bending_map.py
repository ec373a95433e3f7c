"""Map of resistance to bending: where what comes out depends on the number of sweeps."""

from __future__ import annotations

import numpy as np

from pbd_warp.simulation import Simulation
from pbd_warp.stability.cell import STEPS_A_FRAME, run_scene, size_of, stepped, study
from pbd_warp.stability.classify import Figures
from pbd_warp.stability.map import Axis, Map, Panel
from pbd_warp.step.methods import Direct, GaussSeidel, Jacobi, Method


def _cantilever(method: Method) -> Panel:
    """A cell: the rod of stiffness x in y steps a frame for a second; off where it is not in its place."""

    def cell(bending: float, steps: float) -> Figures:
        scene = study("cantilever", bending=bending)
        assert scene.reference is not None
        exact = scene.reference(1.0)

        def off(sim: Simulation) -> float:
            return float(np.abs(sim.state.x.numpy() - exact).max() / size_of(sim.model))

        return run_scene(stepped(scene.changed(frames=60, method=method), steps), energy=False, error=off)

    return Panel(cell)


BENDING = Map(
    name="bending",
    title="A rod that holds itself up, and how stiff it is",
    scene="cantilever",
    x=Axis("B [N m^2]", (0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0), log=True),
    y=Axis(STEPS_A_FRAME, (1, 2, 4, 8, 16, 32, 64), log=True),
    panels={
        "direct": _cantilever(Direct()),
        "gauss-seidel (20)": _cantilever(GaussSeidel(20)),
        "jacobi (20)": _cantilever(Jacobi(20)),
    },
    text="20 links of a metre, 0.1 kg, from the equilibrium of a continuous rod. Off: it has moved by more than 1 % of "
    "the scene in a second. Sweeps pass a moment on by a link each, so what they make of a stiff rod depends on how "
    "many there are; Newton's method makes the same of it at every step.",
)
