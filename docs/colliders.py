"""Draws docs/colliders.png: a rope that falls on one of each solid, after 0.8 s.  python docs/colliders.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import warp as wp
from PIL import Image

import pbd_warp as pbd
from pbd_warp.player.render import Renderer

SECONDS = 0.8
WIDTH, HEIGHT = 760, 420


def model() -> pbd.ModelBuilder:
    builder = pbd.ModelBuilder()
    around, across = np.meshgrid(np.linspace(0, 2 * np.pi, 49)[:-1], np.linspace(0, 2 * np.pi, 25)[:-1], indexing="ij")
    rho = 0.16 + 0.05 * np.cos(across)
    ring = np.stack([rho * np.sin(around), 0.05 * np.sin(across), rho * np.cos(around)], axis=-1).reshape(-1, 3)
    corner = np.arange(48 * 24).reshape(48, 24)
    a, b = corner, np.roll(corner, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    triangles = np.concatenate([np.stack(each, axis=-1).reshape(-1, 3) for each in ((a, b, c), (a, c, d))])
    builder.add_box((-0.72, 0, 0), (0.3, 0.3, 0.4), (0.2, 0.4, 0.1), friction=0.5)
    builder.add_capsule((-0.3, 0, -0.25), (-0.3, 0, 0.25), 0.1, friction=0.5)
    builder.add_mesh(ring, triangles, (0.1, 0.05, 0), (0.4, 0, 0), friction=0.5)
    builder.add_cylinder((0.45, -0.05, -0.25), (0.45, -0.05, 0.25), 0.12, friction=0.5)
    builder.add_cone((0.8, -0.25, 0), (0.8, 0.2, 0), 0.2, friction=0.5)
    for z in (-0.06, 0.06):
        builder.add_rope(np.linspace((-0.95, 0.4, z), (0.95, 0.4, z), 90), mass=0.3, radius=0.01, pinned=())
    return builder


def main() -> None:
    wp.config.log_level = wp.LOG_ERROR
    motion = pbd.Simulation(model(), method=pbd.Direct(), substeps=16).run(SECONDS)
    around = motion.drawn.around(motion.positions[-1:])
    around["low"], around["high"] = [-0.85, -0.25, -0.2], [0.85, 0.3, 0.2]
    pixels = Renderer(motion.drawn, around, 2 * WIDTH, 2 * HEIGHT).draw(motion.positions[-1])
    small = Image.fromarray(pixels).resize((WIDTH, HEIGHT), Image.Resampling.LANCZOS)
    path = Path(__file__).parent / "colliders.png"
    small.quantize(128, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(path, optimize=True)


if __name__ == "__main__":
    main()
