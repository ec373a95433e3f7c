"""What explicit steps are too long for, estimated on the host: springs, ropes held taut, and whips.

Each gives how many times longer than it may be a step of 1 s is [1/s], and says why.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pbd_warp.model.graph import Span, links_of, lowest
from pbd_warp.model.model import Model, masses
from pbd_warp.step.integrators.springs import stiffest

WAY = {"dop853": 0.25, "rk4": 0.16}
"""Of the shortest link: what a whip may move in a step at the speed that its energy is good for. From chains of 5 to 50
links that fall from the horizontal for 10 s: above it they gain energy or break in a crack, at half of it none did."""

SWING = 5.0
"""Times faster than by its weight alone does a rope that is held taut swing as it falls into place."""

FEW = 5
"""Links that a whip has at least."""


def stiff(model: Model, x: np.ndarray, w: np.ndarray, stable: float) -> Iterator[tuple[float, str]]:
    """The swings of springs."""
    edges = model.distance
    soft = edges.compliance > 0.0
    if np.any(soft):
        frequency = float(np.sqrt(stiffest(x, w, edges.edge[soft], edges.compliance[soft])))
        yield frequency / stable, f"a compliance whose swings have up to {frequency:.3g} rad/s is too stiff"


def taut(model: Model, w: np.ndarray, spans: list[Span], stable: float) -> Iterator[tuple[float, str]]:
    """Waves along a rope whose ends are held nearly as far apart as it is long. With the slack s, a part of the length,
    it sags by sqrt(3 s / 8); its tension is its weight over 8 times that, and its fastest wave has 2 sqrt(T / m a)."""
    mass = masses(w)
    for span in spans:
        own = mass[(model.component == span.piece) & (mass > 0.0)]
        links = model.distance.rest_length[model.component[model.distance.edge[:, 0]] == span.piece]
        if not len(own) or span.apart > span.rope * (1.0 + 1e-6):
            continue
        slack = max(1.0 - span.apart / span.rope, 1e-16)
        tension = own.sum() * float(np.linalg.norm(model.gravity)) / (8.0 * np.sqrt(3.0 * slack / 8.0))
        frequency = 2.0 * np.sqrt(tension / (own.min() * links[links > 0.0].min()))
        text = (
            f"a rope of {span.rope:.4g} m held taut between particles {span.start} and {span.end}, {span.apart:.6g} m "
            f"apart, swings too fast"
        )
        yield SWING * float(frequency) / stable, text


def whip(model: Model, x: np.ndarray, v: np.ndarray, w: np.ndarray, way: float) -> Iterator[tuple[float, str]]:
    """Free ends crack with the energy of all that is joined to them: what its motion has, and what its weight has to
    fall to where it would hang straight down from what is held."""
    edges = model.distance
    rigid = (edges.compliance == 0.0) & (edges.rest_length > 0.0)
    mass, g = masses(w), float(np.linalg.norm(model.gravity))
    height = -(x @ model.gravity) / g if g > 0.0 else np.zeros(len(x))
    links = links_of(edges.edge[rigid], edges.rest_length[rigid])
    held = np.flatnonzero(w == 0.0)
    low = lowest(links, {int(i): float(height[i]) for i in held})
    free_ends = [i for i, to in links.items() if len(to) == 1 and w[i] > 0.0]
    for piece in np.unique(model.component[free_ends]):
        own = np.flatnonzero((model.component == piece) & (w > 0.0))
        of_piece = rigid & (model.component[edges.edge[:, 0]] == piece)
        if of_piece.sum() < FEW:
            continue
        share = mass[own] / mass[own].sum()
        hangs = np.any(model.component[held] == piece)
        drift = 0.0 if hangs else share @ v[own]
        energy = 0.5 * share @ np.sum((v[own] - drift) ** 2, axis=1)  # over the mass
        if hangs:
            energy += g * share @ (height[own] - np.array([low.get(int(i), height[i]) for i in own]))
        shortest = float(edges.rest_length[of_piece].min())
        speed = float(np.sqrt(2.0 * max(energy, 0.0)))
        text = f"links of {shortest:.3g} m with the energy of {speed:.3g} m/s crack like a whip"
        yield speed / (way * shortest), text
