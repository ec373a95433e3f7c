"""What integrators of higher order cannot carry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pbd_warp.errors import InputError

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


def refuse_first_order_features(name: str, sim: Simulation) -> None:
    """Contacts and damping change velocities by jumps, and stiffness and recovery depend on the step: all are of first
    order."""
    model = sim.model
    spoilers = {
        "contacts and colliders": model.contacts is not None or len(model.colliders.kind) > 0,
        "damping": sim.damping > 0.0,
        "a depenetration speed": sim.depenetration_speed is not None,
        "stiffness below 1": bool(np.any(model.distance.stiffness < 1.0) or np.any(model.point.stiffness < 1.0)),
    }
    for spoiler, there in spoilers.items():
        if there:
            raise InputError(f"integrator {name!r} does not model {spoiler}: leave it out or use integrator 'pbd'")
