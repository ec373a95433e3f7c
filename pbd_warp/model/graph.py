"""Particles and links as a graph."""

from __future__ import annotations

import heapq

import numpy as np


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
