"""What does not change while a simulation runs (Model) and what does (State)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from pbd_warp.model.bending import BendingSet
from pbd_warp.model.colliders import Colliders
from pbd_warp.model.constraints import DistanceSet, PointSet


@dataclass(frozen=True)
class Contacts:
    """Contact of particles, or of links: Coulomb friction and restitution of all pairs.

    links: Between capsules, which links are then, and particles that no link has.
    """

    friction: float
    restitution: float
    links: bool = False


def masses(w: np.ndarray) -> np.ndarray:
    """Masses [kg] of inverse masses w [1/kg], 0 where w is 0."""
    return np.divide(1.0, w, out=np.zeros(len(w)), where=w > 0.0)


@dataclass(frozen=True, repr=False)
class Model:
    """A particle graph as `ModelBuilder.finalize` leaves it. float64 numpy arrays; simulations copy them to their
    device and precision.

    x, v: initial positions [m] and velocities [m/s], shape [particle_count, 3].
    w: inverse masses [1/kg], shape [particle_count]; 0 is fixed.
    radius [m], shape [particle_count].
    component: the connected component of each particle, shape [particle_count].
    ropes: particle indices along each rope, for drawing and for path solvers.
    copy_count: of how many equal graphs it consists, one after the other (see copies.py).
    """

    gravity: np.ndarray
    x: np.ndarray
    v: np.ndarray
    w: np.ndarray
    radius: np.ndarray
    distance: DistanceSet
    point: PointSet
    bending: BendingSet
    contacts: Contacts | None
    colliders: Colliders
    ropes: tuple[np.ndarray, ...]
    component: np.ndarray
    device: wp.Device
    real: type
    copy_count: int = 1

    @property
    def particle_count(self) -> int:
        return len(self.x)

    @property
    def constraint_count(self) -> int:
        return len(self.distance) + len(self.point) + len(self.bending)

    @property
    def copy_size(self) -> int:
        """Particles of one copy."""
        return self.particle_count // self.copy_count

    @property
    def dtype(self) -> str:
        """ "float32" or "float64"."""
        return self.real.__name__

    @property
    def mass(self) -> np.ndarray:
        """[kg], float64 [particle_count]; 0 of fixed particles."""
        return masses(self.w)

    @property
    def collides(self) -> bool:
        """Whether there is anything to be in contact with."""
        return self.contacts is not None or len(self.colliders) > 0

    def __getstate__(self) -> dict[str, Any]:
        """For pickle and deepcopy: the device and the precision by their names."""
        return {**vars(self), "device": str(self.device), "real": self.dtype}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state, device=wp.get_device(state["device"]), real=getattr(wp, state["real"]))

    def __repr__(self) -> str:
        counts = {"distances": len(self.distance), "points": len(self.point), "bends": len(self.bending)}
        counts["colliders"] = len(self.colliders.kind)
        there = "".join(f", {count} {name}" for name, count in counts.items() if count)
        contacts = ", contacts" if self.contacts else ""
        copies = f" in {self.copy_count} copies" if self.copy_count > 1 else ""
        return f"Model({self.particle_count} particles{there}{contacts}{copies}; {self.dtype} on {self.device})"


@dataclass(frozen=True)
class State:
    """Positions [m] and velocities [m/s], Warp arrays of vec3, shape [particle_count]."""

    x: wp.array
    v: wp.array
