"""What integrators of higher order cannot carry, and explicit ones."""

from __future__ import annotations

import numpy as np

from pbd_warp.errors import InputError
from pbd_warp.model.model import Model


def refuse_first_order_features(name: str, model: Model, damping: float, depenetration_speed: float | None) -> None:
    """Contacts and damping change velocities by jumps, and stiffness and depenetration depend on the step: all are of
    first order."""
    features = {
        "contacts and colliders": model.collides,
        "damping": damping > 0.0,
        "a depenetration speed": depenetration_speed is not None,
        "stiffness below 1": bool(np.any(model.distance.stiffness < 1.0) or np.any(model.point.stiffness < 1.0)),
    }
    for feature, there in features.items():
        if there:
            raise InputError(f"integrator {name!r} does not model {feature}: leave it out or use integrator 'pbd'")


def refuse_forces(name: str, model: Model, drag: float) -> None:
    """Explicit integrators know lengths, springs and points alone; bending would be too stiff for their step."""
    for feature, there in {"bending": len(model.bending) > 0, "drag": drag > 0.0}.items():
        if there:
            raise InputError(
                f"integrator {name!r} does not model {feature}: leave it out or use 'midpoint4' and Direct"
            )
