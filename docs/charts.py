"""Makes the charts of all scenes again: docs/charts/SCENE.csv and .svg.

    pip install '.[chart]' && python docs/charts.py [SCENE ...]

Each is `pbd-warp chart SCENE` at its defaults. On a quiet machine: what else runs is in the figures.
"""

import subprocess
import sys
from pathlib import Path

import pbd_warp as pbd

HERE = Path(__file__).parent / "charts"

for scene in sys.argv[1:] or pbd.scene_names():
    out = HERE / f"{scene}.svg"
    command = "from pbd_warp.cli import main; main()"
    subprocess.run([sys.executable, "-c", command, "chart", scene, "--out", str(out)], check=True)
