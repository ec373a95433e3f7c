"""Draws the pictures of the docs from USD files that the scenes have made.

    pip install '.[chart]' && python docs/pictures.py

Every panel shows one run: faint to strong as time goes by, the drag's path as a dotted line.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from matplotlib.collections import EllipseCollection, LineCollection
from pxr import Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.run import run

HERE = Path(__file__).parent
SCENES = ("worm", "collision", "point", "rope")
SHOWN = {  # time codes
    "worm": range(30, 150, 17),
    "collision": (60, 90, 120),
    "point": (*range(12, 180, 12), 215),
    "rope": range(0, 130, 6),
}


def draw(axes, name: str, stage: Usd.Stage, scene: pbd.Scene) -> None:
    points = UsdGeom.Points.Get(stage, "/World/Particles")
    curves = UsdGeom.BasisCurves.Get(stage, "/World/Ropes")
    width = np.array(points.GetWidthsAttr().Get())
    shown = list(SHOWN[name])
    for order, time in enumerate(shown):
        strength = (
            (0.15 + 0.85 * ((order + 1) / len(shown)) ** 2) if name != "collision" else (order == 2) * 0.75 + 0.08
        )
        x = np.array(points.GetPointsAttr().Get(time))[:, :2]
        axes.add_collection(
            EllipseCollection(width, width, 0 * width, units="x", offsets=x, transOffset=axes.transData,
                              facecolors="#d9733a", alpha=strength, linewidths=0)
        )  # fmt: skip
        if curves:
            line = np.array(curves.GetPointsAttr().Get(time))[:, :2]
            axes.add_collection(LineCollection([line], colors="#3a6fb5", alpha=strength, linewidths=1.3))
    path = np.array([gesture[2] for gesture in scene.drag if gesture[1] == "move"])
    if name != "rope":  # its hand comes later than what is shown
        axes.plot(path[:, 0], path[:, 1], ":", color="0.35", linewidth=0.9)
    if name == "collision":
        axes.add_patch(plt.Rectangle((0, 0), 2.0, 1.4, fill=False, edgecolor="0.3"))
    axes.set_title(name, fontsize=10)
    axes.set_aspect("equal")
    axes.autoscale()
    axes.margins(0.04)
    axes.set_axis_off()


def main() -> None:
    wp.config.log_level = wp.LOG_ERROR
    figure, panels = plt.subplots(2, 2, figsize=(8.4, 6.2), dpi=110)
    with tempfile.TemporaryDirectory() as folder:
        for axes, name in zip(panels.flat, SCENES, strict=True):
            scene = pbd.load_scene(name)
            path = Path(folder) / f"{name}.usdc"
            run(scene, path)
            draw(axes, name, Usd.Stage.Open(str(path)), scene)
    figure.tight_layout()
    figure.savefig(HERE / "scenes.png")


if __name__ == "__main__":
    main()
