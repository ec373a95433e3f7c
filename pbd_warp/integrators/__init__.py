"""How velocity becomes position and back. An integrator has `predict(sim, remaining)` (lines 5-7) and `update(sim)`
(lines 12-15)."""

from pbd_warp.integrators.pbd import PBD

INTEGRATORS = {"pbd": PBD}

__all__ = ["INTEGRATORS", "PBD"]
