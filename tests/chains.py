"""Chains for tests of integrators, and simulations of them."""

import numpy as np
import pytest

import pbd_warp as pbd
from pbd_warp.step.integrators import INTEGRATORS

EPS = {"float32": float(np.finfo(np.float32).eps), "float64": float(np.finfo(np.float64).eps)}
G = 9.81
every_integrator = pytest.mark.parametrize("integrator", INTEGRATORS)
higher_order = pytest.mark.parametrize("integrator", ["bdf2", "midpoint", "midpoint4"])
energy_keeping = pytest.mark.parametrize("integrator", ["midpoint", "midpoint4"])


def chain_model(x, masses, dtype="float64", gravity=(0, -G, 0), velocity=(0, 0, 0), rest_length=None, **soft):
    """Particles joined in a row; mass 0 is fixed."""
    builder = pbd.ModelBuilder(gravity=gravity)
    builder.add_particles(x, velocity, masses)
    builder.add_distances([(k, k + 1) for k in range(len(x) - 1)], rest_length, **soft)
    return builder.finalize(dtype=dtype)


def simulate(model, integrator, **settings):
    return pbd.Simulation(model, method=pbd.Direct(), integrator=integrator, **settings)


def level(links, length=1.0):
    """Positions of a chain that starts level."""
    return np.linspace([0.0, 0, 0], [length, 0, 0], links + 1)
