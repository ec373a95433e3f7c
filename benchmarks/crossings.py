"""What it costs to look for strands that passed through each other: `python benchmarks/crossings.py`, ms a frame."""

import time

import numpy as np

from pbd_warp.crossings import find_crossings


def heap(ropes: int, links: int) -> tuple[np.ndarray, np.ndarray]:
    """Ropes of 20 mm links, each winding from a place in a box of half a metre."""
    rng = np.random.default_rng(0)
    first = (links + 1) * np.arange(ropes)[:, None]
    edge = np.stack([first + np.arange(links), first + np.arange(1, links + 1)], axis=-1).reshape(-1, 2)
    way = 0.4 * rng.normal(size=(ropes, links + 1, 3)) + rng.normal(size=(ropes, 1, 3))
    way *= 0.02 / np.linalg.norm(way, axis=2, keepdims=True)
    return (rng.uniform(-0.25, 0.25, (ropes, 1, 3)) + np.cumsum(way, axis=1)).reshape(-1, 3), edge


if __name__ == "__main__":
    for ropes, links in (1, 35), (10, 100), (50, 100):
        x, edge = heap(ropes, links)
        y = x + 1e-3 * np.random.default_rng(1).normal(size=x.shape)
        seconds = []
        for _ in range(5):
            start = time.perf_counter()
            find_crossings(x, y, edge)
            seconds.append(time.perf_counter() - start)
        print(f"{ropes:3} x {links} links: {1e3 * np.median(seconds):7.2f} ms a frame")
