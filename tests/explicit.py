"""What the tests of the explicit integrator share: a harness, and the differential equations of any rigid graph."""

import numpy as np
from models import state
from scipy.integrate import solve_ivp

import pbd_warp as pbd

DT = 1.0 / 60.0


def explicit(model, frames=0, **settings):
    """A simulation after some frames; "auto" unless it is given substeps."""
    settings = {"substeps": "auto", **settings} if "substeps" not in settings else settings
    sim = pbd.Simulation(model, **{"integrator": "dop853", **settings})
    step(sim, frames)
    return sim


def step(sim, frames):
    for _ in range(frames):
        sim.step()


def where(sim):
    return state(sim)[0]


def motion(model, time, led=(), velocity=None, rtol=1e-12, atol=1e-13):
    """Positions and velocities [particle_count, 3] after a time: M a = f + J^T lam with C'' = 0, least squares where
    constraints are redundant. `led` particles have no mass and the constant `velocity`."""
    x0, v0, w = model.x.copy(), model.v.copy(), model.w.copy()
    w[list(led)] = 0.0
    if len(led):
        v0[list(led)] = velocity
    n, edge, distance = len(w), model.distance.edge, model.distance
    i, j = edge.T
    soft = distance.compliance > 0.0
    rigid = np.flatnonzero(~soft & (w[i] + w[j] > 0.0))
    inverse_mass = np.repeat(w, 3)
    g = np.where(w[:, None] > 0.0, model.gravity, 0.0)

    def rate(t, state):
        x, v = state.reshape(2, n, 3)
        d, d_rate = x[j] - x[i], v[j] - v[i]
        a = g.copy()
        for k in np.flatnonzero(soft):
            length = np.linalg.norm(d[k])
            force = (length - distance.rest_length[k]) / distance.compliance[k] * d[k] / length
            a[i[k]] += w[i[k]] * force
            a[j[k]] -= w[j[k]] * force
        jacobian = np.zeros((len(rigid), n, 3))
        row = np.arange(len(rigid))
        jacobian[row, j[rigid]] += d[rigid]
        jacobian[row, i[rigid]] -= d[rigid]
        jacobian = jacobian.reshape(len(rigid), 3 * n)
        b = -(jacobian @ a.ravel()) - np.sum(d_rate[rigid] ** 2, axis=1)
        lam = np.linalg.lstsq(jacobian * inverse_mass @ jacobian.T, b, rcond=1e-11)[0]
        return np.concatenate([v.ravel(), a.ravel() + inverse_mass * (lam @ jacobian)])

    # A held particle's velocity is there at once: the impulse that takes the others onto the tangent.
    d = x0[j[rigid]] - x0[i[rigid]]
    jacobian = np.zeros((len(rigid), n, 3))
    jacobian[np.arange(len(rigid)), j[rigid]] += d
    jacobian[np.arange(len(rigid)), i[rigid]] -= d
    jacobian = jacobian.reshape(len(rigid), 3 * n)
    impulse = np.linalg.lstsq(jacobian * inverse_mass @ jacobian.T, -(jacobian @ v0.ravel()), rcond=1e-11)[0]
    start = np.concatenate([x0.ravel(), v0.ravel() + inverse_mass * (impulse @ jacobian)])
    solution = solve_ivp(rate, (0.0, time), start, "DOP853", rtol=rtol, atol=atol)
    assert solution.success
    return tuple(solution.y[:, -1].reshape(2, n, 3))
