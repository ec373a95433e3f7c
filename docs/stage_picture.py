"""Draws the picture of stages.md that is of no other program: what a command writes over cables from Blender.

pip install '.[chart,curves]' && python docs/stage_picture.py
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import warp as wp
from pxr import Usd, UsdGeom

from pbd_warp.curves import Material, load_stage, simulate

HERE = Path(__file__).parent
STAGE = HERE.parent / "tests" / "data" / "cables_blender.usda"
SHOWN = ((0, "0.75", 2.0), (12, "#d9733a", 0.7), (24, "#3a6fb5", 1.2))  # time code, colour, line width


def lines(stage: Usd.Stage, time_code: float) -> list[np.ndarray]:
    """Control points in world space of every curve, as (x, z)."""
    found = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.BasisCurves):
            curves = UsdGeom.BasisCurves(prim)
            matrix = np.array(curves.ComputeLocalToWorldTransform(time_code))
            points = np.array(curves.GetPointsAttr().Get(time_code)) @ matrix[:3, :3] + matrix[3, :3]
            found += np.split(points[:, [0, 2]], np.cumsum(curves.GetCurveVertexCountsAttr().Get())[:-1])
    return found


def poles(stage: Usd.Stage) -> list[np.ndarray]:
    """Corners of every mesh in world space, as (x, z)."""
    found = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            matrix = np.array(UsdGeom.Mesh(prim).ComputeLocalToWorldTransform(0))
            points = np.array(UsdGeom.Mesh(prim).GetPointsAttr().Get()) @ matrix[:3, :3] + matrix[3, :3]
            found.append(points[:, [0, 2]])
    return found


def draw(axes: plt.Axes, stage: Usd.Stage, shown: tuple[tuple[float, str, float], ...], title: str) -> None:
    for corners in poles(stage):
        (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
        axes.fill([left, right, right, left], [low, low, high, high], color="0.9")
    for time_code, colour, width in shown:
        for number, line in enumerate(lines(stage, time_code)):
            label = f"{time_code / 24:g} s" if number == 0 else None
            axes.plot(*line.T, color=colour, linewidth=width, label=label)
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal")
    axes.set_axis_off()


def main() -> None:
    wp.config.log_level = wp.LOG_ERROR
    figure, panels = plt.subplots(1, 2, figsize=(8.4, 3.6), dpi=100, sharey=True)
    with tempfile.TemporaryDirectory() as folder:
        for axes, pin in zip(panels, ("root", "ends"), strict=True):
            out = Path(folder) / f"{pin}.usdc"
            simulate(load_stage(STAGE, material=Material(pin=pin), frames=25), out)
            draw(axes, Usd.Stage.Open(str(out)), SHOWN, f"--pin {pin}")
        panels[0].legend(loc="lower left", fontsize=8, frameon=False)
        figure.tight_layout()
        figure.savefig(HERE / "stage.png")


if __name__ == "__main__":
    main()
