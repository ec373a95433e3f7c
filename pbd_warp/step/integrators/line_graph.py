"""The elimination of links laid out beforehand for kernels/graph_multipliers.py: order, factor, who adds what.

Two links are neighbours in the line graph when they share a particle. Eliminating one makes all its neighbours
neighbours of each other; taking each time the one with the fewest (minimum degree) keeps the factor small: 2 places a
link for a closed loop, 2.6 for a tree of 4 branches a knot, 18 for a net of 30 x 30.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Elimination:
    """Int32 arrays, but for `order`; links by their number in the order of elimination.

    order [link_count]: the edge that each link is. first [link_count + 1], row [slots]: the rows of each column below
    the diagonal, ascending. row_first [link_count + 1], row_slot, row_column [slots]: the slots of each row, by column.
    shared_first [link_count + 1], shared_slot, shared_place: for each column, what the entries of its rows are made of:
    slot, and the place of the shared particle plus 1, negative where the two links meet it with opposite ends.
    """

    order: np.ndarray
    first: np.ndarray
    row: np.ndarray
    row_first: np.ndarray
    row_slot: np.ndarray
    row_column: np.ndarray
    shared_first: np.ndarray
    shared_slot: np.ndarray
    shared_place: np.ndarray

    @classmethod
    def of(cls, ends: np.ndarray, piece: np.ndarray) -> Elimination:
        """Of links with these ends, int [link_count, 2], in pieces, ascending int [link_count], one after the other."""
        count = len(ends)
        meeting: dict[int, list[tuple[int, int]]] = {}
        for link, (i, j) in enumerate(ends.tolist()):
            meeting.setdefault(i, []).append((link, -1))
            meeting.setdefault(j, []).append((link, 1))
        neighbours: list[set[int]] = [set() for _ in range(count)]
        for links in meeting.values():
            here = {link for link, _ in links}
            for link in here:
                neighbours[link] |= here
        for link in range(count):
            neighbours[link].discard(link)
        order, columns = _minimum_degree(neighbours)
        order = [order[k] for k in np.argsort(piece[order], kind="stable")]
        number = np.empty(count, np.int64)
        number[order] = np.arange(count)
        rows = [np.sort(number[list(columns[link])]) for link in order]
        first = np.concatenate([[0], np.cumsum([len(r) for r in rows])]).astype(np.int64)
        row = np.concatenate([np.zeros(0, np.int64), *rows])
        column = np.repeat(np.arange(count), np.diff(first))
        row_slot = np.argsort(row, kind="stable")

        pairs = []
        for place, links in meeting.items():
            for n, (a, sign_a) in enumerate(links):
                for b, sign_b in links[:n]:
                    early, late = sorted((int(number[a]), int(number[b])))
                    pairs.append((early, late, sign_a * sign_b * (place + 1)))
        shared = np.array(sorted(pairs), np.int64).reshape(-1, 3)
        slot = np.searchsorted(column * count + row, shared[:, 0] * count + shared[:, 1])
        as_int = np.int32
        return cls(
            np.array(order, np.int64), first.astype(as_int), row.astype(as_int),
            _starts(row, count), row_slot.astype(as_int), column[row_slot].astype(as_int),
            _starts(shared[:, 0], count), slot.astype(as_int), shared[:, 2].astype(as_int),
        )  # fmt: skip


def _starts(values: np.ndarray, count: int) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(np.bincount(values, minlength=count))]).astype(np.int32)


def _minimum_degree(neighbours: list[set[int]]) -> tuple[list[int], list[set[int]]]:
    """The order, and of each node those that it was joined to when its turn came. Uses the sets up."""
    heap = [(len(others), node) for node, others in enumerate(neighbours)]
    heapq.heapify(heap)
    order: list[int] = []
    done = [False] * len(neighbours)
    while heap:
        degree, node = heapq.heappop(heap)
        if done[node] or degree != len(neighbours[node]):
            continue
        done[node] = True
        order.append(node)
        others = neighbours[node]
        for other in others:
            joined = neighbours[other]
            joined |= others
            joined -= {node, other}
            heapq.heappush(heap, (len(joined), other))
    return order, neighbours
