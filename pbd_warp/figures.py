"""The figures of a run: how it goes, and what is told at its end."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pbd_warp import check
from pbd_warp.atomic import write_text
from pbd_warp.errors import InputError
from pbd_warp.measure import measure
from pbd_warp.model.model import Model
from pbd_warp.scene import Scene
from pbd_warp.simulation import Simulation
from pbd_warp.version import __version__


@dataclass(frozen=True)
class RunStats:
    """What a run was and how it went; the fields are the keys of `--stats FILE.json`.

    unconverged: Steps that ended above the method's tolerance, None where it has none.
    stretched_frames: Frames that ended with a rigid link more than 10 % off its length: more than the method could do.
    crossings: How often a link passed through another; None where nobody looked, which runs do where particles or links
        collide. crossed: The first of these in words, with what helps; None without one.
    retried: Frames that were made again after a failure (`on_failure`).
    wall_s: The whole run [s], compiling included; since it was resumed, if it was.
    real_time_factor: Simulated time over that of simulating it; None of a single frame.
    """

    scene: str
    device: str
    dtype: str
    method: str
    integrator: str
    substeps: int
    iterations: int
    frames: int
    compile_s: float
    wall_ms_per_frame: float
    max_stretch: float
    max_residual: float
    energy_start: float
    energy_end: float
    particles: int
    constraints: int
    out: str
    unconverged: int | None
    stretched_frames: int
    crossings: int | None
    crossed: str | None
    retried: int
    wall_s: float
    real_time_factor: float | None

    def save(self, path: Path) -> None:
        """Write them as JSON, whole or not at all (SimulationFailed)."""
        write_text(path, json.dumps(vars(self), indent=2) + "\n")


@dataclass
class Progress:
    """The running figures of a run; with them it is resumed."""

    frames: int
    energy_start: float
    energy: float
    max_stretch: float
    max_residual: float
    unconverged: int | None
    stretched_frames: int = 0
    wall: float = 0.0
    crossings: int | None = None
    crossed: str | None = None

    @classmethod
    def of(cls, data: Any) -> Progress:
        """What `vars` of one was.

        Raises:
            InputError: something else.
        """
        try:
            made = cls(**data)
        except TypeError:
            raise InputError("it does not say how far it came") from None
        check.whole("frames", made.frames, low=1)
        check.whole("stretched_frames", made.stretched_frames, low=0)
        if made.unconverged is not None:
            check.whole("unconverged", made.unconverged, low=0)
        if made.crossings is not None:
            check.whole("crossings", made.crossings, low=0)
        for name in ("energy_start", "energy", "max_stretch", "max_residual", "wall"):
            check.number(name, getattr(made, name))
        return made

    def note(self, sim: Simulation, seconds: float) -> None:
        """Another frame."""
        now = measure(sim)
        self.energy = now.energy
        self.max_stretch = max(self.max_stretch, now.max_stretch)
        self.max_residual = max(self.max_residual, now.residual)
        self.stretched_frames += now.stretched > 0
        if sim.unconverged is not None:
            self.unconverged = (self.unconverged or 0) + sim.unconverged
        self.wall += seconds
        if sim.watches_crossings:
            own = [crossing for crossing in sim.crossings if crossing.frame == sim.frame]
            self.crossings = (self.crossings or 0) + len(own)
            if own and self.crossed is None:
                self.crossed = f"{own[0]}; {crossing_remedy(sim.model)}"


def watch(sim: Simulation) -> None:
    """Look for strands that pass through each other where something is there to keep them apart."""
    if sim.model.contacts is not None and len(sim.model.distance):
        sim.watch_crossings()


def crossing_remedy(model: Model) -> str:
    """What keeps strands apart."""
    if model.contacts and model.contacts.links:
        return "helps: more substeps, or method 'direct'"
    return "helps: contacts between links, enable_contacts(links=True)"


def provenance(scene: Scene, model: Model) -> dict[str, Any]:
    """How a file was made, for its customLayerData."""
    return {
        "version": __version__,
        "scene": scene.name,
        "device": str(model.device),
        "dtype": model.dtype,
        "method": scene.settings.method.name,
        "integrator": scene.settings.integrator,
        "substeps": scene.settings.substeps,
        "iterations": scene.settings.method.iterations,
    }
