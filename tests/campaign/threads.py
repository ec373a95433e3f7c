"""Threads that build, run and change simulations at once get what one alone gets."""

from __future__ import annotations

import threading

import numpy as np

import pbd_warp as pbd

SETTINGS = [
    {"method": pbd.GaussSeidel(5)},
    {"method": pbd.Jacobi(30, tolerance=1e-6), "integrator": "bdf2"},
    {"method": pbd.Direct(7), "on_failure": "subdivide", "limits": pbd.Limits(5.0, 100.0)},
    {"integrator": "dop853"},
    {"capture": False, "damping": 0.1},
]


def _motion(model: pbd.Model, settings: dict, frames: int) -> bytes:
    sim = pbd.Simulation(model, **settings)
    for frame in range(frames):
        if frame == 2:
            sim.grab(2)
        if frame == 4:
            sim.release()
            sim = sim.continue_with(dt=1 / 50)
        sim.step()
    return sim.state.x.numpy().tobytes()


def check(threads: int, rounds: int, frames: int = 8) -> list[str]:
    """Complaints of so many threads."""
    builder = pbd.ModelBuilder()
    builder.add_rope(np.linspace([0, 0, 0], [1, 0, 0], 12), pinned=())
    model = builder.finalize(dtype="float64")
    alone = [_motion(model, settings, frames) for settings in SETTINGS]
    complaints: list[str] = []

    def work(first: int) -> None:
        for number in range(rounds):
            which = (first + number) % len(SETTINGS)
            try:
                if _motion(model, SETTINGS[which], frames) != alone[which]:
                    complaints.append(f"{SETTINGS[which]}: another motion")
            except Exception as error:
                complaints.append(f"{SETTINGS[which]}: {type(error).__name__}: {error}")

    working = [threading.Thread(target=work, args=(number,)) for number in range(threads)]
    for thread in working:
        thread.start()
    for thread in working:
        thread.join()
    return complaints
