"""Particles and links as a graph."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

MOST_ENDS = 64
"""Held particles of a piece from which ways to others are sought."""


def links_of(edge: np.ndarray, length: np.ndarray) -> dict[int, list[tuple[int, float]]]:
    """Of each particle, who it is linked to, and how long that link is [m]."""
    links: dict[int, list[tuple[int, float]]] = {}
    for (i, j), rest in zip(edge.tolist(), length.tolist(), strict=True):
        links.setdefault(i, []).append((j, rest))
        links.setdefault(j, []).append((i, rest))
    return links


def reach(links: dict[int, list[tuple[int, float]]], start: int, held: np.ndarray) -> dict[int, float]:
    """Of the held particles, bool [particle_count], that are found from one of them through free ones: the length of
    the shortest way there [m] (Dijkstra 1959). Held neighbours are left out: nothing between them can give."""
    found: dict[int, float] = {}
    done: set[int] = set()
    queue = [(0.0, start, 0)]
    while queue:
        way, at, steps = heapq.heappop(queue)
        if at in done:
            continue
        done.add(at)
        if held[at] and at != start:
            if steps > 1:
                found[at] = way
            continue
        for to, rest in links.get(at, []):
            heapq.heappush(queue, (way + rest, to, steps + 1))
    return found


def neighbours(edge: np.ndarray, particle_count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Adjacency of a graph: the neighbours of i are neighbour[start[i]:start[i + 1]], and which[k] is the edge that
    leads to neighbour[k]."""
    both = np.concatenate([edge, edge[:, ::-1]])
    order = np.argsort(both[:, 0], kind="stable")
    start = np.searchsorted(both[order, 0], np.arange(particle_count + 1))
    return start, both[order, 1], order % max(len(edge), 1)


@dataclass(frozen=True)
class Span:
    """A rope of rigid links from one held particle to another, and how far they are apart [m]."""

    piece: int
    start: int
    end: int
    apart: float
    rope: float


def spans(
    component: np.ndarray, edge: np.ndarray, length: np.ndarray, x: np.ndarray, held: np.ndarray
) -> Iterator[Span]:
    """The shortest ropes between particles that are held, bool [particle_count]."""
    links = links_of(edge, length)
    for piece in np.flatnonzero(np.bincount(component[held]) > 1).tolist():
        for start in np.flatnonzero(held & (component == piece))[:MOST_ENDS].tolist():
            for end, rope in reach(links, start, held).items():
                if rope > 0.0 and start < end:
                    yield Span(piece, start, end, float(np.linalg.norm(x[start] - x[end])), rope)


def lowest(links: dict[int, list[tuple[int, float]]], held: dict[int, float]) -> dict[int, float]:
    """How low each particle could hang [m], by the heights of those that are held: straight down from one of them."""
    found: dict[int, float] = {}
    queue = [(-height, at) for at, height in held.items()]  # the depth; the least of all ways is the one that holds
    heapq.heapify(queue)
    while queue:
        depth, at = heapq.heappop(queue)
        if at not in found:
            found[at] = -depth
            for to, rest in links.get(at, []):
                heapq.heappush(queue, (depth + rest, to))
    return found


def components(edge: np.ndarray, particle_count: int) -> np.ndarray:
    """The connected component of each particle, numbered from 0, int32 [particle_count]."""
    label = np.arange(particle_count)
    while True:
        low = np.minimum(label[edge[:, 0]], label[edge[:, 1]])
        new = label.copy()
        # The labels of both ends, and the ends' present representatives, sink to the lower one; then the
        # representatives are followed, which halves every way to the root.
        for end in (edge[:, 0], edge[:, 1], label[edge[:, 0]], label[edge[:, 1]]):
            np.minimum.at(new, end, low)
        new = new[new]
        if np.array_equal(new, label):
            return np.unique(label, return_inverse=True)[1].astype(np.int32)
        label = new
