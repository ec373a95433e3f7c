"""A particle graph as connected pieces: paths, whose links need no index, and other graphs."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pbd_warp.kernels.precision import BLOCK
from pbd_warp.step.constraints.distance import DistanceSet
from pbd_warp.step.integrators.line_graph import Elimination


@dataclass(frozen=True)
class Pieces:
    """Places: all particles, one connected piece after the other, those of a path in its order, each from a multiple of
    BLOCK on.

    first, end: int32 [piece_count], where each piece begins and ends in `vertex`. vertex: int32 [place_count], the
    particle at each place, -1 at those left out. is_path: bool [piece_count]. link: int32 [place_count], of a path: the
    edge from each place to the next, -1 for none. edges: of each piece that is no path, its edges, int32.
    """

    first: np.ndarray
    end: np.ndarray
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
        first: list[int] = []
        end: list[int] = []
        is_path: list[bool] = []
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
                came = [next(number for to, number in around[a] if to == b) for a, b in pairwise(members)]
                link += [*came, -1]
            else:
                edges[len(is_path)] = np.array(sorted(ways), np.int32)
                link += [-1] * len(members)
            first.append(len(vertex))
            vertex += members
            is_path.append(path)
            end.append(len(vertex))
            unused = -len(vertex) % int(BLOCK)
            vertex += [-1] * unused
            link += [-1] * unused
        as_int = lambda values: np.array(values, np.int32)  # noqa: E731
        return cls(as_int(first), as_int(end), as_int(vertex), np.array(is_path, bool), as_int(link), edges)


@dataclass(frozen=True)
class Graph:
    """What the pieces that are no paths are made of, numbered by places.

    link_first: int32 [piece_count + 1]. ends: int32 [link_count, 2]. length: [link_count] [m], of the rigid links in
    the order of their elimination. schedule: the other arrays of
    `Elimination` by name, all pieces' in one.
    spring_first, spring_ends, spring_length, spring_compliance: the same of compliant distances [m, m/N].
    """

    link_first: np.ndarray
    ends: np.ndarray
    length: np.ndarray
    schedule: dict[str, np.ndarray]
    spring_first: np.ndarray
    spring_ends: np.ndarray
    spring_length: np.ndarray
    spring_compliance: np.ndarray

    @classmethod
    def of(cls, pieces: Pieces, distance: DistanceSet) -> Graph:
        used = np.flatnonzero(pieces.vertex >= 0)
        place = np.empty(len(used), np.int64)
        place[pieces.vertex[used]] = used
        links, springs = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)]
        link_first, spring_first = [0], [0]
        for piece in range(len(pieces.is_path)):
            edges = pieces.edges.get(piece, np.zeros(0, np.int64))
            soft = distance.compliance[edges] > 0.0
            links.append(edges[~soft])
            springs.append(edges[soft])
            link_first.append(link_first[-1] + int(np.sum(~soft)))
            spring_first.append(spring_first[-1] + int(np.sum(soft)))
        link, spring = np.concatenate(links), np.concatenate(springs)
        # Pieces share no particle: one elimination of all, sorted by piece, is each one's own.
        e = Elimination.of(place[distance.edge[link]], np.repeat(np.arange(len(links) - 1), np.diff(link_first)))
        link = link[e.order]
        return cls(
            np.array(link_first, np.int32), place[distance.edge[link]].astype(np.int32), distance.rest_length[link],
            {name: array for name, array in vars(e).items() if name != "order"},
            np.array(spring_first, np.int32), place[distance.edge[spring]].astype(np.int32),
            distance.rest_length[spring], distance.compliance[spring],
        )  # fmt: skip
