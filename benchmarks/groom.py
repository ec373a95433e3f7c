"""How long a groom takes: 10 000 hairs of 20 points, 24 frames, as linear curves and as cubic ones.

    taskset -c 0 python benchmarks/groom.py [--hairs 10000]

Each run is a process of its own, the whole command `pbd-warp simulate` from reading to the finished file, on one core.
The limits are 30 s for linear and 90 s for cubic curves; the ratios to them are printed, and the times of reading,
solving and writing as the command tells them.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, Vt

POINTS = 20
FRAMES = 24
LIMITS = {"linear": 30.0, "bspline": 90.0, "catmullRom": 90.0, "bezier": 90.0}  # [s]


def write_groom(path: Path, basis: str, hairs: int) -> None:
    """Hairs of some 20 cm that stand on a sphere of 10 cm, each a little bent."""
    rng = np.random.default_rng(0)
    points = POINTS if basis != "bezier" else 3 * (POINTS // 3) + 1
    way = rng.normal(size=(hairs, 1, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    s = np.linspace(0.0, 0.2, points)[:, None]
    x = way * (0.1 + s) + 0.02 * np.sin(8.0 * s) * rng.normal(size=(hairs, 1, 3))
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(FRAMES - 1)
    curves = UsdGeom.BasisCurves.Define(stage, "/Hair")
    curves.CreateTypeAttr("linear" if basis == "linear" else "cubic")
    if basis != "linear":
        curves.CreateBasisAttr(basis)
    curves.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(x.reshape(-1, 3).astype(np.float32)))
    curves.CreateCurveVertexCountsAttr(Vt.IntArray([points] * hairs))
    curves.CreateWidthsAttr([0.001])
    curves.SetWidthsInterpolation("constant")
    stage.Save()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hairs", type=int, default=10_000)
    parser.add_argument("--bases", nargs="*", default=list(LIMITS), choices=list(LIMITS))
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for basis in given.bases:
            groom = Path(folder) / f"{basis}.usdc"
            write_groom(groom, basis, given.hairs)
            command = [
                sys.executable,
                "-c",
                "from pbd_warp.cli import main; main()",
                "simulate",
                str(groom),
                "--out",
                f"{folder}/out.usdc",
            ]
            start = time.perf_counter()
            run = subprocess.run(command, capture_output=True, text=True, check=False)
            seconds = time.perf_counter() - start
            if run.returncode:
                sys.exit(run.stderr)
            told = dict(line.split(maxsplit=1) for line in run.stdout.splitlines() if line.startswith("time"))
            print(
                f"{basis:11} {seconds:6.1f} s, {seconds / LIMITS[basis]:.2f} of the limit; {told['time']}", flush=True
            )


if __name__ == "__main__":
    main()
