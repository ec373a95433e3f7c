"""Checkpoints with one byte changed: refused, or what they were."""

from __future__ import annotations

import json
import random
from pathlib import Path

from campaign.processes import Processes

LOADS = """
import json, random, sys
import numpy as np
import pbd_warp as pbd
from pbd_warp.checkpoint import Checkpoint
from pbd_warp.model.flat import flat_arrays

path, seed, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])

def content(checkpoint):
    arrays = {**dict(flat_arrays(checkpoint.model)), **checkpoint.arrays}
    texts = [checkpoint.settings.to_json(), checkpoint.progress, checkpoint.extra, checkpoint.model.dtype]
    return json.dumps(texts), {name: (a.dtype, a.shape, a.tobytes()) for name, a in arrays.items()}

whole = open(path, "rb").read()
expected = content(Checkpoint.read(path))
chance = random.Random(seed)
figures = {"refused": 0, "identical": 0, "wrong": []}
for _ in range(count):
    place = chance.randrange(len(whole))
    damaged = bytearray(whole)
    damaged[place] ^= chance.randrange(1, 256)
    with open("damaged.npz", "wb") as file:
        file.write(damaged)
    try:
        got = content(Checkpoint.read("damaged.npz"))
    except pbd.InputError:
        figures["refused"] += 1
        continue
    if got == expected:
        figures["identical"] += 1
    else:
        figures["wrong"].append([place, damaged[place]])
print(json.dumps(figures))
"""

SAVES = """
import sys
import pbd_warp as pbd
builder = pbd.ModelBuilder()
builder.add_rope([(0.1 * i, 0, 0) for i in range(int(sys.argv[1]))], radius=0.02)
builder.add_plane((0, -1, 0), (0, 1, 0))
builder.add_point(3)
builder.enable_contacts()
sim = pbd.Simulation(builder.finalize(), substeps=2)
sim.step()
sim.grab(2)
sim.save("c.npz")
"""

BATCH = 500
"""Damages in one process: a crash or a hang is noticed soon."""


def check(processes: Processes, folder: Path, count: int, seed: int = 0) -> tuple[dict[str, int], list[str]]:
    """Damage a checkpoint so many times; gives figures and complaints."""
    folder.mkdir(parents=True, exist_ok=True)
    ended = processes.call("5", cwd=folder, code=SAVES)
    assert ended.code == 0, ended.err
    chance = random.Random(seed)
    figures = {"damages": 0, "refused": 0, "identical": 0}
    complaints = []
    while figures["damages"] < count:
        batch = min(BATCH, count - figures["damages"])
        ended = processes.call("c.npz", chance.randrange(1 << 30), batch, cwd=folder, code=LOADS)
        figures["damages"] += batch
        if ended.code or ended.complaint:
            complaints.append(f"{ended.complaint}: {ended.last_line}")
            continue
        got = json.loads(ended.out)
        figures["refused"] += got["refused"]
        figures["identical"] += got["identical"]
        complaints += [f"byte {place} as {value} loads as something else" for place, value in got["wrong"]]
    return figures, complaints
