"""Whether one strand passed through another between two frames: the check that contacts are judged by.

Every particle moves on a straight line from frame to frame. Two links lie in one plane where the triple product
f = (a x b) . r of both directions and what is between them is zero, a cubic in time; its roots are found between its
extremes by bisection, and each is a passage where the axes cross inside both links. Links that stay in one plane pass
where an end of one goes over the other, which is a quadratic in time.
Source: Provot 1997, Collision and self-collision handling in cloth model; float64, and no code of the contacts.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, takewhile

import numpy as np

INSIDE = 1e-9
"""Of a link beyond its ends: what goes through a joint is seen by one of both links at least, and counted once."""

FLAT = 1e-12
"""Of the volume that links could span: what is less is rounding, and the links stay in one plane."""

SAME = 1e-6
"""Of a frame and of the extent of everything: passages nearer in time and space are one, through a joint."""

PAIRS_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class Crossing:
    """One passage.

    frame: In which it happened: that at whose end it was found.
    links: Distances, the lower one first.
    time: Within the frame, 0..1.
    point: Where [m].
    """

    frame: int
    links: tuple[int, int]
    time: float
    point: tuple[float, float, float]

    def __str__(self) -> str:
        at = ", ".join(f"{value:.3g}" for value in self.point)
        return f"links {self.links[0]} and {self.links[1]} passed through each other in frame {self.frame} at ({at}) m"


def find_crossings(before: np.ndarray, after: np.ndarray, link: np.ndarray, frame: int = 0) -> list[Crossing]:
    """All passages between two frames, in time.

    Args:
        before, after: Positions [m], float64 [particle_count, 3].
        link: Both ends, int [link_count, 2]. Links that share a particle cannot pass through each other.
    """
    found = [_passages(before, after, link, pair) for pair in _near_pairs(before, after, link)]
    crossings: list[Crossing] = []
    scale = float(np.abs(after - before).max(initial=0.0) + np.ptp(before, axis=0).max(initial=0.0))
    for time, a, b, point in sorted((row for rows in found for row in rows), key=lambda row: row[0]):
        if not _known(crossings, time, point, SAME * scale):
            x, y, z = point.tolist()
            crossings.append(Crossing(frame, (int(a), int(b)), float(time), (x, y, z)))
    return crossings


def _known(crossings: list[Crossing], time: float, point: np.ndarray, near: float) -> bool:
    """Whether a passage at this time and place is there already: a joint is an end of two links."""
    at_once = takewhile(lambda other: time - other.time < SAME, reversed(crossings))
    return any(np.linalg.norm(np.subtract(point, other.point)) <= near for other in at_once)


def _near_pairs(before: np.ndarray, after: np.ndarray, link: np.ndarray) -> Iterator[np.ndarray]:
    """Pairs of links without a common particle whose boxes, over all the way, overlap: along the axis of largest extent
    sorted by where they begin."""
    corners = np.stack([before[link[:, 0]], before[link[:, 1]], after[link[:, 0]], after[link[:, 1]]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    axis = int(np.argmax(np.ptp(before, axis=0)))
    order = np.argsort(low[:, axis], kind="stable")
    last = np.searchsorted(low[order, axis], high[order, axis], side="right")
    count = last - np.arange(len(order)) - 1
    ends = np.cumsum(count)
    start = 0
    while start < len(order):
        stop = max(int(np.searchsorted(ends, (ends[start - 1] if start else 0) + PAIRS_AT_ONCE)), start + 1)
        here = np.arange(start, min(stop, len(order)))
        one = np.repeat(here, count[here])
        other = np.arange(len(one)) - np.repeat(np.cumsum(count[here]) - count[here], count[here]) + one + 1
        a, b = order[one], order[other]
        near = np.all((low[a] <= high[b]) & (low[b] <= high[a]), axis=1)
        near &= np.all(link[a][:, :, None] != link[b][:, None, :], axis=(1, 2))
        yield np.stack([np.minimum(a, b)[near], np.maximum(a, b)[near]], axis=1)
        start = stop


Passage = tuple[float, int, int, np.ndarray]


def _passages(before: np.ndarray, after: np.ndarray, link: np.ndarray, pair: np.ndarray) -> list[Passage]:
    """Of pairs of links, int [n, 2]: time, both links, point of each passage."""
    if not len(pair):
        return []
    corner = np.concatenate([link[pair[:, 0]], link[pair[:, 1]]], axis=1).T
    x, move = before[corner], (after - before)[corner]  # [4, n, 3]
    a, b, r = (_line(x, move, i, j) for i, j in ((0, 1), (2, 3), (0, 2)))
    cubic = _dot(_cross(a, b), r)
    size = np.prod([np.linalg.norm(each[0], axis=1) + np.linalg.norm(each[1], axis=1) for each in (a, b, r)], axis=0)
    flat = np.abs(cubic).max(axis=0) <= FLAT * size
    found = []
    some, time = _roots(np.where(flat, 1.0, cubic))
    s, t, point = _meeting(x[:, some] + time[:, None] * move[:, some])
    inside = (np.minimum(s, t) >= -INSIDE) & (np.maximum(s, t) <= 1.0 + INSIDE)
    for k, at, where in zip(some[inside], time[inside], point[inside], strict=True):
        found.append((at, *pair[k], where))
    for k in np.flatnonzero(flat):
        found += [(at, *pair[k], where) for at, where in _in_plane(x[:, k], move[:, k])]
    return found


def _line(x: np.ndarray, move: np.ndarray, i: int, j: int) -> np.ndarray:
    """From corner i to corner j as a polynomial in time, [2, n, 3]."""
    return np.stack([x[j] - x[i], move[j] - move[i]])


def _cross(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    return np.stack(
        [np.cross(p[0], q[0]), np.cross(p[0], q[1]) + np.cross(p[1], q[0]), np.cross(p[1], q[1])],
    )


def _dot(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Of a polynomial of order m - 1 with one of order 1, [m + 1, n]."""
    out = np.zeros((len(p) + 1, p.shape[1]))
    for k, each in enumerate(p):
        out[k] += np.sum(each * q[0], axis=-1)
        out[k + 1] += np.sum(each * q[1], axis=-1)
    return out


def _value(polynomial: np.ndarray, time: np.ndarray) -> np.ndarray:
    out = np.zeros_like(time)
    for coefficient in polynomial[::-1]:
        out = out * time + coefficient
    return out


def _roots(cubic: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where cubics, [4, n], change sign in 0 < t <= 1: which of them, and t."""
    d, c, b, a = cubic
    bernstein = np.stack([d, d + c / 3.0, d + 2.0 * c / 3.0 + b / 3.0, d + c + b + a])
    maybe = np.flatnonzero((bernstein.min(axis=0) <= 0.0) & (bernstein.max(axis=0) >= 0.0))
    cubic = cubic[:, maybe]
    _, c, b, a = cubic
    # The extremes of a cubic, 3 a t^2 + 2 b t + c = 0, without cancellation.
    q = -(b + np.copysign(np.sqrt(np.maximum(b * b - 3.0 * a * c, 0.0)), b))
    with np.errstate(all="ignore"):
        extremes = np.nan_to_num(np.stack([q / (3.0 * a), c / q]), nan=0.0, posinf=0.0, neginf=0.0)
    zero, one = np.zeros((1, len(maybe))), np.ones((1, len(maybe)))
    split = np.concatenate([zero, np.sort(np.clip(extremes, 0.0, 1.0), axis=0), one])
    which, times = [], []
    for low, high in pairwise(split):
        first, last = _value(cubic, low), _value(cubic, high)
        some = np.flatnonzero((np.sign(first) * np.sign(last) < 0.0) | ((last == 0.0) & (first != 0.0)))
        low, high, sign = low[some], high[some], np.sign(first[some])
        for _ in range(60):
            middle = 0.5 * (low + high)
            before = np.sign(_value(cubic[:, some], middle)) == sign
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        which.append(maybe[some])
        times.append(high)
    return np.concatenate(which), np.concatenate(times)


def _meeting(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where on both of two segments in one plane their lines meet, and the point; x: [4, n, 3]."""
    a, b, r = x[1] - x[0], x[3] - x[2], x[2] - x[0]
    normal = np.cross(a, b)
    size = np.sum(normal**2, axis=1)
    with np.errstate(all="ignore"):
        s = np.sum(np.cross(r, b) * normal, axis=1) / size
        t = np.sum(np.cross(r, a) * normal, axis=1) / size
    s, t = (np.nan_to_num(each, nan=np.inf) for each in (s, t))
    return s, t, x[0] + np.where(np.isfinite(s), s, 0.0)[:, None] * a


def _in_plane(x: np.ndarray, move: np.ndarray) -> Iterator[tuple[float, np.ndarray]]:
    """Times and points at which an end of one goes over the other, of a pair that stays in one plane; x: [4, 3]."""
    spanned = np.cross(x[1] - x[0] + move[1] - move[0], np.concatenate([x - x[0], x + move - x[0] - move[0], move]))
    normal = spanned[np.argmax(np.sum(spanned**2, axis=1))]
    for end, (p, q) in ((0, (2, 3)), (1, (2, 3)), (2, (0, 1)), (3, (0, 1))):
        side = _cross(_line(x[:, None], move[:, None], p, q), _line(x[:, None], move[:, None], p, end)) @ normal
        _, times = _roots(np.concatenate([side, np.zeros((1, 1))]))
        for time in times:
            now = x + time * move
            along = now[q] - now[p]
            at = (now[end] - now[p]) @ along
            if -INSIDE <= at / max(along @ along, 1e-300) <= 1.0 + INSIDE:
                yield float(time), now[end]
