"""A particle graph as connected pieces: paths, whose links need no index, and other graphs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Pieces:
    """Places: all particles, one connected piece after the other, those of a path in its order.

    first: int32 [piece_count + 1], where each piece begins in `vertex`. vertex: int32 [particle_count], the particle at
    each place. is_path: bool [piece_count]. link: int32 [particle_count], of a path: the edge from each place to the
    next, -1 for none. edges: of each piece that is no path, its edges, int32.
    """

    first: np.ndarray
    vertex: np.ndarray
    is_path: np.ndarray
    link: np.ndarray
    edges: dict[int, np.ndarray]

    @classmethod
    def of(cls, particle_count: int, edge: np.ndarray) -> Pieces:
        around: list[list[tuple[int, int]]] = [[] for _ in range(particle_count)]
        for number, (i, j) in enumerate(edge.tolist()):
            around[i].append((j, number))
            around[j].append((i, number))
        degree = np.array([len(a) for a in around], dtype=np.int64)
        vertex: list[int] = []
        link: list[int] = []
        first, is_path = [0], []
        edges: dict[int, np.ndarray] = {}
        done = np.zeros(particle_count, bool)
        # From the ends of paths first, so that what begins elsewhere closes.
        for start in [*np.flatnonzero(degree <= 1).tolist(), *np.flatnonzero(degree > 1).tolist()]:
            if done[start]:
                continue
            done[start] = True
            members, ways, stack = [start], set(), [start]
            while stack:
                at = stack.pop()
                for to, number in around[at]:
                    ways.add(number)
                    if not done[to]:
                        done[to] = True
                        members.append(to)
                        stack.append(to)
            path = len(ways) == len(members) - 1 and bool(np.all(degree[members] <= 2))
            if path:  # depth first from an end: members are in its order
                came = [next(number for to, number in around[a] if to == b) for a, b in zip(members, members[1:], strict=False)]
                link += [*came, -1]
            else:
                edges[len(is_path)] = np.array(sorted(ways), np.int32)
                link += [-1] * len(members)
            vertex += members
            is_path.append(path)
            first.append(len(vertex))
        as_int = lambda values: np.array(values, np.int32)  # noqa: E731
        return cls(as_int(first), as_int(vertex), np.array(is_path, bool), as_int(link), edges)
