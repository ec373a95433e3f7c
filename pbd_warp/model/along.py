"""Which links lie too near each other along a rope to be kept apart from each other."""

from __future__ import annotations

import numpy as np

from pbd_warp.model.graph import neighbours

Pairs = tuple[np.ndarray, np.ndarray]


def close_along(link: np.ndarray, length: np.ndarray, radius: np.ndarray, particle_count: int) -> Pairs:
    """Of each link, those from whose ends the way along links to its own ends is at most pi times the mean radius: as
    long as half a turn of a tube that is bent until it touches itself. Nearer ones would touch in a straight rope, or
    in one that is bent no more than its thickness allows.

    Args:
        link: int32 [link_count, 2]. length, radius: Of each [m], float64 [link_count].

    Returns:
        start, neighbour: those of link e are neighbour[start[e]:start[e + 1]].
    """
    n = len(link)
    source, to, way = _ways(link, length, np.pi * radius.max(initial=0.0), particle_count)
    order = np.argsort(link.ravel(), kind="stable")
    owner, first = order // 2, np.searchsorted(link.ravel()[order], np.arange(particle_count + 1))
    # Links at `source` meet those at `to`.
    k, one = _each(first, source)
    m, other = _each(first, to[k])
    one, other, way = owner[one[m]], owner[other], way[k][m]
    near = (one != other) & (way <= 0.5 * np.pi * (radius[one] + radius[other]))
    pair = np.unique(one[near].astype(np.int64) * n + other[near])
    return np.searchsorted(pair // max(n, 1), np.arange(n + 1)), pair % max(n, 1)


def _each(first: np.ndarray, group: np.ndarray) -> Pairs:
    """All members of groups, those of g from first[g] to first[g + 1]: (place in `group`, member) of each."""
    count = first[group + 1] - first[group]
    place = np.repeat(np.arange(len(group)), count)
    within = np.arange(len(place)) - np.repeat(np.cumsum(count) - count, count)
    return place, first[group][place] + within


def _ways(link: np.ndarray, length: np.ndarray, most: float, particle_count: int) -> tuple[np.ndarray, ...]:
    """Particles and how far it is between them along links, where that is at most `most`: (source, to, way)."""
    start, neighbour, which = neighbours(link, particle_count)
    source = to = np.arange(particle_count)
    way = np.zeros(particle_count)
    known: tuple[np.ndarray, ...] = (source, to, way)
    while len(source):
        k, at = _each(start, to)
        source, to, way = source[k], neighbour[at], way[k] + length[which[at]]
        found = way <= most
        merged = tuple(np.concatenate(both) for both in zip(known, (source[found], to[found], way[found]), strict=True))
        # The shortest way to each comes first; what was there before is not gone on from.
        order = np.lexsort((merged[2], merged[1], merged[0]))
        merged = tuple(column[order] for column in merged)
        fresh = np.ones(len(order), bool)
        fresh[1:] = (merged[0][1:] != merged[0][:-1]) | (merged[1][1:] != merged[1][:-1])
        new = fresh & (order >= len(known[0]))
        known = tuple(column[fresh] for column in merged)
        source, to, way = (column[new] for column in merged)
    return known
