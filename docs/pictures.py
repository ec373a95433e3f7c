"""Draws the pictures of the docs from USD files that the scenes have made.

    pip install '.[test]' && python docs/pictures.py

scenes.png: every panel shows one run, faint to strong as time goes by, the drag's path as a dotted line.
view.png: the live view, as the browser tests have seen it (they need Chromium).
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from matplotlib.collections import EllipseCollection, LineCollection
from PIL import Image
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
    if name != "rope":  # its drag comes later than what is shown
        axes.plot(path[:, 0], path[:, 1], ":", color="0.35", linewidth=0.9)
    if name == "collision":
        axes.add_patch(plt.Rectangle((0, 0), 2.0, 1.4, fill=False, edgecolor="0.3"))
    axes.set_title(name, fontsize=10)
    axes.set_aspect("equal")
    axes.autoscale()
    axes.margins(0.04)
    axes.set_axis_off()


def view() -> None:
    """One whole page, below it what the others show beside their panels."""
    with tempfile.TemporaryDirectory() as folder:
        tests = [str(HERE.parent / "tests" / "test_view_browser.py"), "-k", "click_hover_click", "--pictures", folder]
        subprocess.run([sys.executable, "-m", "pytest", *tests], check=True)
        pages = {name: Image.open(Path(folder) / f"{name}.png").convert("RGB") for name in SCENES}
    width, gap = 1100, 6
    large = pages.pop("rope")
    large = large.resize((width, width * large.height // large.width), Image.Resampling.LANCZOS)
    side = (width - 2 * gap) // 3
    picture = Image.new("RGB", (width, large.height + gap + side * 3 // 4), "white")
    picture.paste(large)
    for number, page in enumerate(pages.values()):
        stage = page.width - 2 * 288  # without the panel, at two pixels a unit
        scale = min(stage / 4, page.height / 3)
        left, top = (stage - 4 * scale) / 2, (page.height - 3 * scale) / 2
        box = (left, top, left + 4 * scale, top + 3 * scale)
        small = page.resize((side, side * 3 // 4), Image.Resampling.LANCZOS, box)
        picture.paste(small, (number * (side + gap), large.height + gap))
    picture.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(HERE / "view.png", optimize=True)


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
    view()


if __name__ == "__main__":
    main()
