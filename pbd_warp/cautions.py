"""What is known to fail, told before the first step: each is a map of the stability atlas (docs/stability)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from pbd_warp.errors import InputError
from pbd_warp.methods.direct import Direct, paths
from pbd_warp.methods.jacobi import Jacobi
from pbd_warp.spectrum import largest_eigenvalue

if TYPE_CHECKING:
    from pbd_warp.simulation import Simulation

STRETCHED = 0.1
"""Stretch that counts as a failure, as in the atlas."""

WHIP = 0.3
"""A link that turns by this angle in a step [rad] under its own weight is too much for "midpoint" as a whip."""

NOISE = 0.01
"""Velocity from rounding positions, relative to that of falling by a link's length, that counts as a failure."""


ROUND_OFF = 1e-6
"""Of a length, by which it is the same."""


@dataclass(frozen=True)
class Caution:
    """One thing that is known to fail, and does so with these settings where severity is above 1.

    test: The name of the check, and of the map in the atlas that shows the boundary and knows the remedy.
    """

    test: str
    text: str
    severity: float

    @property
    def remedy(self) -> str:
        from pbd_warp.stability.maps import MAPS  # which run simulations

        return MAPS[self.test].cure

    def __str__(self) -> str:
        return f"{self.text}: {self.remedy} (test: {self.test})"


@dataclass(frozen=True)
class _Now:
    """The state to be judged: positions [m] and velocities [m/s], float64 [particle_count, 3]."""

    x: np.ndarray
    v: np.ndarray


def cautions(sim: Simulation, failed: bool = False) -> list[Caution]:
    """All checks that apply, the worst first; those with a severity above 1 are known to fail.

    Args:
        failed: The simulation has just failed. Where its particles are then says nothing about why, so they are judged
            where they began; but for those that are held, which are where they are led to.
    """
    x = (sim.model.x if failed else sim.state.x.numpy()).astype(np.float64)
    v = (sim.model.v if failed else sim.state.v.numpy()).astype(np.float64)
    if failed:
        fixed = sim.w.numpy() == 0.0
        x[fixed] = sim.state.x.numpy()[fixed]
    if sim.held is not None:
        x[sim.held] = sim.grab_target.numpy()[0]
    now = _Now(np.nan_to_num(x), np.nan_to_num(v))
    found = [c for test in TESTS for c in test(sim, now)]
    return sorted(found, key=lambda caution: -caution.severity)


def nearest_remedy(sim: Simulation) -> str:
    """Of a simulation that failed: what its state and settings are known to fail of, and the cure; empty if nothing."""
    known = [c for c in cautions(sim, failed=True) if c.severity > 1.0]
    return f"{known[0].text}: {known[0].remedy}" if known else ""


def _relaxation(sim: Simulation, now: _Now) -> Iterator[Caution]:
    """Jacobi converges where relaxation times the largest eigenvalue of a sweep is below 2; over many steps of an odd
    number K of sweeps, where it is below 1 + 3^(-1/K) (pbd_warp/stability/theory.py)."""
    method = sim.method
    if not isinstance(method, Jacobi) or (method.averaging == "mass-splitting" and method.relaxation <= 1.0):
        return
    largest = max(largest_eigenvalue(sim.model, method, now.x), 1e-300)
    limit, at_odd = 2.0 / largest, (1.0 + 3.0 ** (-1.0 / method.iterations)) / largest
    # At the limit itself an error neither grows nor falls, and the estimate of it is good to some 0.1 %.
    severity = method.relaxation / limit * (1.0 + 1e-3)
    text = f"relaxation {method.relaxation:g} is above {limit:.3g}, the limit of Jacobi sweeps on this graph"
    yield Caution("relaxation", text, severity)
    if method.iterations % 2:
        text = f"relaxation {method.relaxation:g} is above {at_odd:.3g}, the limit of {method.iterations} sweeps a step"
        yield Caution("sweeps", text, method.relaxation / at_odd)


def _truncation(sim: Simulation, now: _Now) -> Iterator[Caution]:
    """K sweeps are like springs: a link that carries a tension T hangs stretched by h^2 T (n_i w_i + n_j w_j) / K.

    From the stretch of truncated Jacobi, B^K (sum P B^k)^-1 h^2 T, for few sweeps on a long chain. T is taken as the
    weight of all that hangs on the same fixed particles, three times over when it swings.
    """
    method, model = sim.method, sim.model
    edges = model.distance
    rated = edges.rest_length > 0.0
    if isinstance(method, Direct) or not np.any(rated):
        return
    w = sim.w.numpy().astype(np.float64)
    mass = np.divide(1.0, w, out=np.zeros_like(w), where=w > 0.0)
    locked = w == 0.0
    locked[model.point.particle] = True
    parts = int(model.component.max()) + 1
    weight = np.bincount(model.component, mass, parts) * np.linalg.norm(model.gravity)
    weight[np.bincount(model.component, locked, parts) == 0.0] = 0.0  # what hangs on nothing falls without tension
    i, j = edges.edge[rated].T
    share = np.ones_like(w)
    if isinstance(method, Jacobi) and method.averaging == "mass-splitting":
        share = np.maximum(method.valence(model), 1).astype(np.float64)
    sweeps = method.iterations * (method.relaxation if isinstance(method, Jacobi) else 2.0)
    denominator = share[i] * w[i] + share[j] * w[j]
    tension = 3.0 * weight[model.component[i]]
    stretch = sim.substep_dt**2 * tension * denominator / (sweeps * edges.rest_length[rated])
    stretch[edges.compliance[rated] > 0.0] = 0.0
    worst = int(np.argmax(stretch))
    part = model.component[i[worst]]
    masses = mass[(model.component == part) & (mass > 0.0)]
    ratio = float(masses.max() / masses.min()) if len(masses) else 1.0
    links = int(np.sum(model.component[edges.edge[:, 0]] == part))
    heavy = ratio > links
    about = f"a mass ratio of {ratio:.3g}" if heavy else f"a chain of {links} links"
    text = (
        f"{about} is too much for {method.iterations} iterations at {sim.substeps} substeps (estimated stretch "
        f"{100 * stretch[worst]:.2g} %)"
    )
    test = "mass_ratio" if heavy else "chain_length"
    yield Caution(test, text, float(stretch[worst]) / STRETCHED)
    if sim.depenetration_speed is not None:
        longest = float((stretch * edges.rest_length[rated]).max())
        text = f"a depenetration speed of {sim.depenetration_speed:g} m/s does not take back what a step stretches"
        yield Caution(test, text, longest / (sim.depenetration_speed * sim.substep_dt))


def _step(sim: Simulation, now: _Now) -> Iterator[Caution]:
    """The step is too long for what moves in it."""
    model = sim.model
    h = sim.substep_dt
    if sim.integrator.mean_gradient and len(model.distance):
        shortest = model.distance.rest_length[model.distance.rest_length > 0.0].min(initial=np.inf)
        turn = h * np.sqrt(np.linalg.norm(model.gravity) / shortest)
        text = f"a step of {h:.3g} s is long for links of {shortest:.3g} m and an integrator that damps nothing"
        yield Caution("step", text, float(turn) / WHIP)
    solid = model.radius > 0.0
    if sim.contacts and np.any(solid):
        speed = np.linalg.norm(now.v, axis=1).max()
        smallest = float(model.radius[solid].min())
        text = f"{speed:.3g} m/s is {speed * h / smallest:.2g} radii a step: what it pushes may pass through others"
        yield Caution("speed", text, float(speed * h / (2.0 * smallest)))


def _precision(sim: Simulation, now: _Now) -> Iterator[Caution]:
    """Positions are stored rounded: far out each step makes velocity out of that."""
    model = sim.model
    lengths = np.concatenate([model.distance.rest_length, model.radius])
    lengths = lengths[lengths > 0.0]
    if not len(lengths):
        return
    far = float(np.abs(now.x).max())
    rounding = float(np.finfo(model.dtype).eps) * far
    gravity = float(np.linalg.norm(model.gravity))
    typical = np.sqrt(gravity * float(lengths.min())) or float(np.linalg.norm(model.v, axis=1).max())
    if typical > 0.0:
        severity = rounding / sim.substep_dt / (NOISE * typical)
        text = f"{model.dtype} rounds positions {far:.3g} m from the origin to {rounding:.1g} m"
        yield Caution("precision", text, float(severity))


def _unreachable(sim: Simulation, now: _Now) -> Iterator[Caution]:
    """Two ends held further apart than the rope between them, with particles that move, is long."""
    model = sim.model
    if not isinstance(sim.method, Direct):
        return
    x = now.x.copy()
    locked = sim.w.numpy() == 0.0
    targets = sim.point_target.numpy() if sim.point_target is not None else np.zeros((0, 3))
    rigid = model.point.compliance == 0.0
    locked[model.point.particle[rigid]] = True
    x[model.point.particle[rigid]] = targets[rigid]
    edges = model.distance
    try:
        vertex, first, link = paths(edges.edge, model.point.particle)
    except InputError:
        return  # a graph that is no set of paths
    length = np.where(link >= 0, np.append(edges.rest_length, 0.0)[link], 0.0)
    soft = np.where(link >= 0, np.append(edges.compliance, 0.0)[link] > 0.0, False)
    for begin, end in pairwise(first):
        held = begin + np.flatnonzero(locked[vertex[begin:end]])
        for a, b in pairwise(held):
            apart, rope = float(np.linalg.norm(x[vertex[a]] - x[vertex[b]])), float(length[a:b].sum())
            if b > a + 1 and apart > 0.0 and not soft[a:b].any():
                text = f"particles {vertex[a]} and {vertex[b]} are held {apart:.4g} m apart, on a rope of {rope:.4g} m"
                # Held straight it carries nothing: where there is weight that is as bad as too far.
                most = rope * (1.0 - ROUND_OFF if np.any(model.gravity) else 1.0 + ROUND_OFF)
                yield Caution("unreachable", text, apart / most)


TESTS = (_unreachable, _relaxation, _truncation, _step, _precision)
