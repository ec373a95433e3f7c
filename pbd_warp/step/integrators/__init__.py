"""How velocity becomes position and back. An integrator has `order`, `mean_gradient` (forces along the mean of the
configurations before and after), the `stages` of its step, and for each of them `predict(stage)` (lines 5 and 7) and
`update(stage)` (lines 12-15); `restart()` forgets the past."""

from pbd_warp.step.integrators.bdf2 import BDF2
from pbd_warp.step.integrators.dop853 import DOP853
from pbd_warp.step.integrators.explicit import Explicit
from pbd_warp.step.integrators.midpoint import Midpoint
from pbd_warp.step.integrators.midpoint4 import Midpoint4
from pbd_warp.step.integrators.pbd import PBD
from pbd_warp.step.integrators.rk4 import RK4

Integrator = PBD | BDF2 | Midpoint
INTEGRATORS: dict[str, type[PBD] | type[BDF2] | type[Midpoint]] = {
    "pbd": PBD,
    "bdf2": BDF2,
    "midpoint": Midpoint,
    "midpoint4": Midpoint4,
}

EXPLICIT: dict[str, type[Explicit]] = {"dop853": DOP853, "rk4": RK4}
"""Those that make a frame by themselves, without the paper's loop and its methods."""

ESTIMATING = tuple(name for name, integrator in EXPLICIT.items() if integrator.estimates)
"""Those that can choose their steps themselves."""

__all__ = [
    "BDF2", "DOP853", "ESTIMATING", "EXPLICIT", "INTEGRATORS", "PBD", "RK4", "Explicit", "Integrator", "Midpoint",
    "Midpoint4",
]  # fmt: skip
