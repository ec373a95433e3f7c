"""Stiffness and compliance on their way from the user's numbers to a kernel's arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from pbd_warp.errors import InputError

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation


class Parameters:
    """k' and compliance of one set in one simulation, and its multipliers; None where nothing needs them.

    stiffness: k' = 1 - (1 - k)^(1 / iterations), so that a step leaves (1 - k) of an error for every number of
    iterations (Mueller et al. 2007, section 3.3).
    compliance: kernels divide it by the integrator's force scale (dt^2 for "pbd": alpha~ of Macklin et al. 2016, XPBD,
    eq. 18). The multiplier is zeroed once a step: zeroing it in every iteration would make the stiffness depend on
    their number.
    """

    def __init__(self, sim: Simulation, name: str, stiffness: np.ndarray, compliance: np.ndarray, lam_dtype: type):
        self._sim = sim
        self.stiffness = self.compliance = self.lam = None
        if np.any(stiffness < 1.0):
            each = 1.0 - (1.0 - stiffness) ** (1.0 / sim.method.iterations)
            self.stiffness = sim.upload(f"{name}.stiffness", each)
        if np.any(compliance > 0.0):
            self.compliance = sim.upload(f"{name}.compliance", compliance)
            self.lam = sim.allocate(f"{name}.lam", len(compliance), lam_dtype)

    def begin(self) -> None:
        if self.lam is not None:
            self._sim.launch.zero(self.lam)


def check_parameters(name: str, stiffness: np.ndarray, compliance: np.ndarray) -> None:
    """Stiffness and compliance are two models of the same softness; one constraint takes one of them."""
    both = np.flatnonzero((stiffness < 1.0) & (compliance > 0.0))
    if both.size:
        raise InputError(f"{name} has a stiffness below 1 and a compliance above 0: give it one of the two")
