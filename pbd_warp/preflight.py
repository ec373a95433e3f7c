"""Preflight checks: what is known to fail, told before the first step, each with its remedy.

Each check is a map of the stability atlas (docs/stability), which quotes the remedy from here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pbd_warp.model.graph import Span, spans
from pbd_warp.model.model import masses
from pbd_warp.snapshot import Snapshot
from pbd_warp.step.divergence import STRETCHED
from pbd_warp.step.integrators import EXPLICIT, INTEGRATORS, limits
from pbd_warp.step.methods.bends import folds, softened
from pbd_warp.step.methods.direct import Direct
from pbd_warp.step.methods.gauss_seidel import GaussSeidel
from pbd_warp.step.methods.jacobi import Jacobi
from pbd_warp.step.methods.spectrum import JacobiSweep

WHIP = 0.3
"""A link that turns by this angle in a step [rad] under its own weight is too much for "midpoint" as a whip."""

NOISE = 0.01
"""Velocity from rounding positions, relative to that of falling by a link's length, that counts as a failure."""

ROUNDED = 4.0
"""Machine epsilons that a position is off after a hundred steps: a random walk in halves."""

ROUND_OFF = 1e-6
"""Of a length, by which it is the same."""

MANY = 200.0
"""Steps of a frame that "auto" is better not left to."""

ENOUGH_SWEEPS = 5
"""Of Gauss-Seidel in a step of an integrator that keeps energy: with fewer, chains of up to 60 links gained some, in
runs of 10 s; with so many none did, and by Jacobi, whose sweeps are symmetric, none did with any number."""

SMALLER_STEPS = "use more substeps"

REMEDIES = {
    "relaxation": "keep averaging='mass-splitting' and the relaxation at 1",
    "star": "use averaging='mass-splitting', GaussSeidel, or a smaller relaxation",
    "overconstrained": "use averaging='mass-splitting', or give each distance once",
    "sweeps": "use an even number of iterations, or a relaxation of 1",
    "chain_length": "use Direct, or more substeps",
    "mass_ratio": "use Direct, or more substeps",
    "chebyshev": "use a smaller rho for what moves, or Direct",
    "sweep_energy": "use Direct, 5 iterations or more, or integrator 'bdf2'",
    "step": "use integrator 'bdf2', or more substeps",
    "precision": "use float64, or move the scene to the origin",
    "drag": "use Direct, or more substeps",
    "speed": "use more substeps, or float64",
    "overlap": "start without overlap, or limit the depenetration speed",
    "unreachable": "hold them nearer to each other, or give the links a compliance",
    "cradle": "leave gaps wider than a step's way",
    "coincident": "start particles apart, or use more iterations",
    "capstan": "use Direct",
    "short_link": "use Direct, or float64",
    "loops": "use more substeps",
    "bending": "use Direct, or more substeps, and start without folds",
}
"""What was seen to help against each failure of the atlas, by the name of the check and of the map."""


@dataclass(frozen=True)
class PreflightWarning:
    """One thing that is known to fail, and does so with these settings where severity is above 1.

    test: The name of the check, and of the map in the atlas that shows the boundary and knows the remedy.
    """

    test: str
    text: str
    severity: float

    @property
    def remedy(self) -> str:
        return REMEDIES[self.test]

    def __str__(self) -> str:
        return f"{self.text}: {self.remedy} (test: {self.test})"


def preflight(now: Snapshot) -> list[PreflightWarning]:
    """All checks that apply, the worst first; those with a severity above 1 are known to fail."""
    checks = EXPLICIT_CHECKS if now.settings.integrator in EXPLICIT else CHECKS
    found = [warning for check in checks for warning in check(now)]
    return sorted(found, key=lambda warning: -warning.severity)


def nearest_remedy(failed: Snapshot) -> str:
    """Of a simulation that failed: what its state and settings are known to fail of, and the cure; empty if nothing."""
    known = [warning for warning in preflight(failed.before) if warning.severity > 1.0]
    return f"{known[0].text}: {known[0].remedy}" if known else ""


def _relaxation(now: Snapshot) -> Iterator[PreflightWarning]:
    """Jacobi converges where relaxation times the largest eigenvalue of a sweep is below 2; over many steps of an odd
    number K of sweeps, where it is below 1 + 3^(-1/K) (pbd_warp/stability/theory.py)."""
    method = now.settings.method
    if not isinstance(method, Jacobi) or (method.averaging == "mass-splitting" and method.relaxation <= 1.0):
        return
    sweep = JacobiSweep(now.model, method.averaging, method.valence(now.model), now.x)
    largest = max(sweep.largest_eigenvalue(), 1e-300)
    limit, at_odd = 2.0 / largest, (1.0 + 3.0 ** (-1.0 / method.iterations)) / largest
    # At the limit itself an error neither grows nor falls, and the estimate of it is good to some 0.1 %.
    severity = method.relaxation / limit * (1.0 + 1e-3)
    text = f"relaxation {method.relaxation:g} is above {limit:.3g}, the limit of Jacobi sweeps on this graph"
    yield PreflightWarning("relaxation", text, severity)
    if method.iterations % 2:
        text = f"relaxation {method.relaxation:g} is above {at_odd:.3g}, the limit of {method.iterations} sweeps a step"
        yield PreflightWarning("sweeps", text, method.relaxation / at_odd)


def _truncation(now: Snapshot) -> Iterator[PreflightWarning]:
    """K sweeps are like springs: a link that carries a tension T hangs stretched by h^2 T (n_i w_i + n_j w_j) / K.

    From the stretch of truncated Jacobi, B^K (sum P B^k)^-1 h^2 T, for few sweeps on a long chain. T is taken as the
    weight of all that hangs on the same fixed particles, three times over when it swings.
    """
    method, model = now.settings.method, now.model
    edges = model.distance
    rated = edges.rest_length > 0.0
    if isinstance(method, Direct) or not np.any(rated):
        return
    w, settings = now.w, now.settings
    mass = masses(w)
    locked = w == 0.0
    locked[model.point.particle] = True
    pieces = int(model.component.max()) + 1
    weight = np.bincount(model.component, mass, pieces) * np.linalg.norm(model.gravity)
    weight[np.bincount(model.component, locked, pieces) == 0.0] = 0.0  # what hangs on nothing falls without tension
    i, j = edges.edge[rated].T
    valence = np.ones_like(w)
    if isinstance(method, Jacobi) and method.averaging == "mass-splitting":
        valence = np.maximum(method.valence(model), 1).astype(np.float64)
    sweeps = method.iterations * (method.relaxation if isinstance(method, Jacobi) else 2.0)
    denominator = valence[i] * w[i] + valence[j] * w[j]
    tension = 3.0 * weight[model.component[i]]
    stretch = settings.step_dt**2 * tension * denominator / (sweeps * edges.rest_length[rated])
    stretch[edges.compliance[rated] > 0.0] = 0.0
    worst = int(np.argmax(stretch))
    piece = model.component[i[worst]]
    own = mass[(model.component == piece) & (mass > 0.0)]
    ratio = float(own.max() / own.min()) if len(own) else 1.0
    links = int(np.sum(model.component[edges.edge[:, 0]] == piece))
    heavy = ratio > links
    about = f"a mass ratio of {ratio:.3g}" if heavy else f"a chain of {links} links"
    text = (
        f"{about} is too much for {method.iterations} iterations at {settings.substeps} substeps (estimated stretch "
        f"{100 * stretch[worst]:.2g} %)"
    )
    test = "mass_ratio" if heavy else "chain_length"
    yield PreflightWarning(test, text, float(stretch[worst]) / STRETCHED)
    if (speed := settings.depenetration_speed) is not None:
        longest = float((stretch * edges.rest_length[rated]).max())
        text = f"a depenetration speed of {speed:g} m/s does not take back what a step stretches"
        yield PreflightWarning(test, text, longest / (speed * settings.step_dt))


def _sweep_energy(now: Snapshot) -> Iterator[PreflightWarning]:
    """What few sweeps of Gauss-Seidel leave over, which falls on one end rather than the other, is work; "midpoint",
    which damps nothing, keeps it."""
    method, integrator = now.settings.method, now.settings.integrator
    if isinstance(method, GaussSeidel) and INTEGRATORS[integrator].mean_gradient and len(now.model.distance) > 1:
        text = f"{method.iterations} sweeps of Gauss-Seidel in a step of {integrator!r} gain energy in the long run"
        yield PreflightWarning("sweep_energy", text, ENOUGH_SWEEPS / method.iterations)


def _step(now: Snapshot) -> Iterator[PreflightWarning]:
    """The step is too long for what moves in it."""
    model = now.model
    h = now.settings.step_dt
    if INTEGRATORS[now.settings.integrator].mean_gradient and len(model.distance):
        shortest = model.distance.rest_length[model.distance.rest_length > 0.0].min(initial=np.inf)
        turn = h * np.sqrt(np.linalg.norm(model.gravity) / shortest)
        text = f"a step of {h:.3g} s is long for links of {shortest:.3g} m and an integrator that damps nothing"
        yield PreflightWarning("step", text, float(turn) / WHIP)
    solid = model.radius > 0.0
    if model.collides and np.any(solid):
        speed = np.linalg.norm(now.v, axis=1).max()
        smallest = float(model.radius[solid].min())
        text = f"{speed:.3g} m/s is {speed * h / smallest:.2g} radii a step: what it pushes may pass through others"
        yield PreflightWarning("speed", text, float(speed * h / (2.0 * smallest)))


def _overlap(now: Snapshot) -> Iterator[PreflightWarning]:
    """What has its middle inside of a collider is put out of it in a step, and keeps the speed of that."""
    model = now.model
    if now.overlaps is None or not len(model.colliders) or now.settings.depenetration_speed is not None:
        return
    depth = np.where(now.w > 0.0, now.overlaps[0], 0.0)
    worst = int(np.argmax(depth))
    if depth[worst] > 0.0:
        name, speed = model.colliders.name(int(now.overlaps[1][worst])), depth[worst] / now.settings.step_dt
        text = f"particle {worst} begins {depth[worst]:.3g} m inside {name}, which it leaves at {speed:.3g} m/s"
        yield PreflightWarning("overlap", text, float(depth[worst] / (1.001 * model.radius[worst] + ROUND_OFF)))


def _precision(now: Snapshot) -> Iterator[PreflightWarning]:
    """Positions are stored rounded: far out each step makes velocity out of that."""
    model = now.model
    lengths = np.concatenate([model.distance.rest_length, model.radius])
    lengths = lengths[lengths > 0.0]
    if not len(lengths):
        return
    far = float(np.abs(now.x).max())
    rounding = float(np.finfo(model.dtype).eps) * far
    gravity = float(np.linalg.norm(model.gravity))
    typical = np.sqrt(gravity * float(lengths.min())) or float(np.linalg.norm(model.v, axis=1).max())
    if typical > 0.0:
        severity = rounding / now.settings.step_dt / (NOISE * typical)
        text = f"{model.dtype} rounds positions {far:.3g} m from the origin to {rounding:.1g} m"
        yield PreflightWarning("precision", text, float(severity))


def _spans(now: Snapshot) -> list[Span]:
    """Ropes of rigid links between particles that are held."""
    model, edges = now.model, now.model.distance
    x, held = now.x.copy(), now.w == 0.0
    rigid = model.point.compliance == 0.0
    held[model.point.particle[rigid]] = True
    x[model.point.particle[rigid]] = now.point_target[rigid]
    links = edges.compliance == 0.0
    return list(spans(model.component, edges.edge[links], edges.rest_length[links], x, held))


def _bending(now: Snapshot) -> Iterator[PreflightWarning]:
    bends, settings = now.model.bending, now.settings
    for text, severity in (*folds(bends, now.x), *softened(bends, settings.method, settings.step_dt, now.w)):
        yield PreflightWarning("bending", text, severity)


def _unreachable(now: Snapshot) -> Iterator[PreflightWarning]:
    """Particles held further apart than the rigid links between them are long: the worst pair of each piece."""
    worst: dict[int, Span] = {}
    for span in _spans(now):
        if span.piece not in worst or span.apart / span.rope > worst[span.piece].apart / worst[span.piece].rope:
            worst[span.piece] = span
    for span in worst.values():
        text = (
            f"particles {span.start} and {span.end} are held {span.apart:.4g} m apart, on a rope of {span.rope:.4g} m"
        )
        yield PreflightWarning("unreachable", text, span.apart / span.rope / (1.0 + ROUND_OFF))


def _explicit_steps(now: Snapshot) -> Iterator[PreflightWarning]:
    """What explicit steps are too long for; and what makes those that are chosen too short to wait for."""
    model, settings = now.model, now.settings
    stable = EXPLICIT[settings.integrator].stable
    w = now.w.copy()
    w[model.point.particle] = 0.0
    causes = [("step", found) for found in limits.stiff(model, now.x, now.w, stable)]
    causes += [("unreachable", found) for found in limits.taut(model, w, _spans(now), stable)]
    if not settings.auto:
        causes += [("step", found) for found in limits.whip(model, now.x, now.v, w, limits.WAY[settings.integrator])]
    for test, (rate, text) in causes:
        if settings.auto:
            steps = settings.dt * rate
            yield PreflightWarning(test, f"{text}: some {steps:.0f} steps a frame or more", steps / MANY)
        else:
            h = settings.step_dt
            yield PreflightWarning(test, f"{text} for a step of {h:.3g} s", h * rate)


def _rounding(now: Snapshot) -> Iterator[PreflightWarning]:
    """Positions are rounded at every step, some hundred times a second."""
    if now.settings.error is None:
        return
    far = float(np.abs(now.x).max())
    rounding = ROUNDED * float(np.finfo(now.model.dtype).eps) * far
    text = f"{now.model.dtype} rounds positions {far:.3g} m from the origin to {rounding:.1g} m in a second of steps"
    yield PreflightWarning("precision", text, rounding / now.settings.error)


CHECKS = (_unreachable, _bending, _relaxation, _truncation, _sweep_energy, _step, _overlap, _precision)
EXPLICIT_CHECKS = (_unreachable, _explicit_steps, _rounding)
