"""Stiffness and compliance on their way from the user's numbers to a kernel's arrays."""

from __future__ import annotations

import numpy as np

from pbd_warp.step.context import Context


class Parameters:
    """k' and compliance of one set of constraints on a device, and its multipliers; None where nothing needs them.

    stiffness: k' = 1 - (1 - k)^(1 / iterations), so that a step leaves (1 - k) of an error for every number of
    iterations (Mueller et al. 2007, section 3.3).
    compliance: kernels divide it by the integrator's force scale (dt^2 for "pbd": alpha~ of Macklin et al. 2016, XPBD,
    eq. 18). The multiplier is zeroed once a step: zeroing it in every iteration would make the stiffness depend on
    their number.
    """

    def __init__(
        self,
        context: Context,
        name: str,
        stiffness: np.ndarray,
        compliance: np.ndarray,
        iterations: int,
        lam_dtype: type,
    ):
        self._context = context
        self.stiffness = self.compliance = self.lam = None
        if np.any(stiffness < 1.0):
            each = 1.0 - (1.0 - stiffness) ** (1.0 / iterations)
            self.stiffness = context.upload(f"{name}.stiffness", each)
        if np.any(compliance > 0.0):
            self.compliance = context.upload(f"{name}.compliance", compliance)
            self.lam = context.allocate(f"{name}.lam", len(compliance), lam_dtype)

    def begin(self) -> None:
        if self.lam is not None:
            self._context.launch.zero(self.lam)
