"""What can be said of a graph of particles without a device."""

from __future__ import annotations

import numpy as np


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
