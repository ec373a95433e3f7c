"""Mutated input: argument lists, stages and recordings of drags. No traceback, hang or crash, and no wrong output."""

from __future__ import annotations

import contextlib
import json
import os
import random
import shutil
from collections.abc import Callable, Container, Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, Vt

from campaign.processes import Ended, Processes

STAGE = Path(__file__).parents[1] / "data" / "cables_blender.usda"

NUMBERS = ["0", "-1", "1", "2", "1e308", "-1e308", "1e-300", "nan", "inf", "2147483648", "9" * 20, "0x10"]
TEXTS = ["", " ", "a\nb", "\udcff", "x" * 300, "--help", "-", "*", "[", "é", "null", "../..", "/", "a b", "\x1b[31m"]
PATHS = ["out.usda", "out.usdc", "out.usd", "in.usda", "own.py", "c.npz", "folder", "folder/x.usda", "nowhere/x.usda"]
PATHS += ["/dev/null", "/dev/full", "/proc/self/mem", "out.partial.usda", "link.usda", "s.json", "@x@.usda", "a#b.usdc"]

RUN = {
    "--out": PATHS,
    "--frames": ["1", "3", "34"],
    "--device": ["cpu", "cuda:7"],
    "--dtype": ["float32", "float64", "float16"],
    "--seed": NUMBERS,
    "--set": ["links=3", "links=x", "links", "=", "links=0"],
    "--accuracy": ["1e-3", *NUMBERS],
    "--checkpoint": PATHS,
    "--every": ["1", "2", *NUMBERS],
    "--resume": None,
    "--drags": PATHS,
    "--stats": PATHS,
    "--fps": ["30", *NUMBERS],
    "--method": ["jacobi", "gauss-seidel", "direct", "jakobi"],
    "--iterations": ["3", *NUMBERS],
    "--tolerance": ["1e-4", *NUMBERS],
    "--substeps": ["2", "auto", *NUMBERS],
    "--integrator": ["pbd", "bdf2", "midpoint", "midpoint4", "dop853", "rk4", "euler"],
    "--damping": ["0.1", *NUMBERS],
    "--max-contacts": ["9", *NUMBERS],
    "--depenetration-speed": ["1", *NUMBERS],
    "--on-failure": ["continue", "raise", "subdivide", "fallback", "pray"],
    "--debug": None,
}
SIMULATE = {
    **{name: values for name, values in RUN.items() if name not in ("--seed", "--set", "--accuracy", "--drags")},
    "--prim": ["/root", "/root/*", "/no", *TEXTS],
    "--collide": ["/root/*", "/no", *TEXTS],
    "--pin": ["root", "ends", "none", "primvar:x", *TEXTS],
    "--density": NUMBERS,
    "--mass": NUMBERS,
    "--compliance": NUMBERS,
    "--gravity": NUMBERS,
    "--flatten": None,
}
CHART = {"--out": ["c.svg", *PATHS], "--csv": ["c.csv", *PATHS], "--from-csv": PATHS, "--pick": NUMBERS}
INFO = {name: RUN[name] for name in ("--fps", "--method", "--iterations", "--substeps", "--dtype", "--integrator")}
COMMANDS: dict[str, tuple[list[str], dict[str, Any]]] = {
    "run": (["worm", "rope", "chain", "own.py", "none", "point"], RUN),
    "simulate": (["in.usda", "link.usda", "own.py", "none.usda"], SIMULATE),
    "chart": ([], CHART),
    "info": (["worm", "chain"], INFO),
    "list": ([], {}),
}

OWN = """
import pbd_warp as pbd
def scene():
    builder = pbd.ModelBuilder()
    builder.add_rope([(0, 0, 0), (1, 0, 0)])
    return pbd.Scene(builder, 3)
"""

SHORT = {"run": ["--frames", "3"], "simulate": ["--frames", "3"]}
"""Last on the line, so that what is legal is also short."""

HEAVY = {"--substeps", "--iterations", "--seed"}
"""A legal million of these takes its time, which is said, and is not what is tried here."""


def arguments(chance: random.Random) -> list[str]:
    """A command line, mostly of options that there are, with values that are mostly wrong."""
    name = chance.choices(list(COMMANDS), [5, 5, 1, 1, 0.2])[0]
    positional, options = COMMANDS[name]
    line = [name, *([chance.choice(positional)] if positional and chance.random() < 0.97 else [])]
    if name == "simulate":
        line += ["--out", chance.choice(PATHS)]
    for _ in range(chance.randrange(0, 4)):
        if not options:
            break
        option = chance.choice(list(options))
        values = options[option]
        line.append(option)
        if values is not None:
            line.append(chance.choice([*values, *TEXTS, *NUMBERS] if chance.random() < 0.3 else values))
    if chance.random() < 0.1:
        line.insert(chance.randrange(1, len(line) + 1), chance.choice(TEXTS))
    return [*line, *SHORT.get(name, [])]


def check_arguments(processes: Processes, folder: Path, count: int, seed: int = 0) -> Iterator[tuple[str, str]]:
    chance = random.Random(seed)
    for _ in range(count):
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "folder").mkdir(parents=True)
        shutil.copy(STAGE, folder / "in.usda")
        (folder / "link.usda").symlink_to("folder/target.usda" if chance.random() < 0.5 else "in.usda")
        (folder / "own.py").write_text(OWN)
        line = arguments(chance)
        ended = processes.call(*line, cwd=folder)
        complaint = "" if "--debug" in line and "Traceback" in ended.err else ended.complaint
        for name, content in (("in.usda", STAGE.read_text()), ("own.py", OWN)):
            read = len(line) > 1 and os.path.realpath(folder / line[1]) == os.path.realpath(folder / name)
            if read and (folder / name).read_text() != content:
                complaint = complaint or f"{name} was replaced"
        others = {value for option, value in pairwise(line) if option in ("--stats", "--checkpoint", "--csv")}
        yield " ".join(map(repr, line)), complaint or _wrong_outputs(folder, ended, others)


# Stages.


def check_stages(processes: Processes, folder: Path, count: int, seed: int = 0) -> Iterator[tuple[str, str]]:
    chance = random.Random(seed)
    for number in range(count):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        name = "in.usdc" if chance.random() < 0.4 else "in.usda"
        how = chance.choice([_attribute, _attribute, _metadata, _bytes, _line])
        said = how(folder / name, chance)
        more = ["--flatten"] if chance.random() < 0.2 else []
        ended = processes.call("simulate", name, "--out", "out.usda", "--frames", 4, "--mass", 1, *more, cwd=folder)
        yield f"{number} {name}: {said}", ended.complaint or _wrong_outputs(folder, ended)


def _stage(file: Path) -> Usd.Stage:
    layer = Sdf.Layer.OpenAsAnonymous(str(STAGE))
    return Usd.Stage.Open(layer)


VALUES: list[Callable[[random.Random], tuple[Sdf.ValueTypeName, Any]]] = [
    lambda c: (Sdf.ValueTypeNames.Int, c.choice([0, -1, 7, 2**31 - 1])),
    lambda c: (Sdf.ValueTypeNames.IntArray, Vt.IntArray([c.randrange(-3, 9) for _ in range(c.randrange(5))])),
    lambda c: (Sdf.ValueTypeNames.IntArray, Vt.IntArray([2**31 - 1] * 3)),
    lambda c: (Sdf.ValueTypeNames.StringArray, Vt.StringArray(["a", "b"])),
    lambda c: (Sdf.ValueTypeNames.String, "x"),
    lambda c: (Sdf.ValueTypeNames.Token, c.choice(["cubic", "bezier", "pinned", "periodic", "nonsense", ""])),
    lambda c: (Sdf.ValueTypeNames.TokenArray, Vt.TokenArray(["xformOp:nothing", "xformOp:translate"])),
    lambda c: (
        Sdf.ValueTypeNames.FloatArray,
        Vt.FloatArray([c.choice([0, -1, np.nan, np.inf, 1e38])] * c.randrange(9)),
    ),
    lambda c: (Sdf.ValueTypeNames.Float, c.choice([0.0, np.nan, -np.inf, 3.0])),
    lambda c: (
        Sdf.ValueTypeNames.Point3fArray,
        Vt.Vec3fArray([Gf.Vec3f(c.choice([0, 1e38, np.nan]))] * c.randrange(99)),
    ),
    lambda c: (Sdf.ValueTypeNames.Double3, Gf.Vec3d(c.choice([0.0, np.nan, 1e300, 1.0]))),
    lambda c: (Sdf.ValueTypeNames.Matrix4d, Gf.Matrix4d(c.choice([0.0, np.nan, 1e200, 1.0]))),
    lambda c: (Sdf.ValueTypeNames.Bool, True),
    lambda c: (Sdf.ValueTypeNames.Asset, Sdf.AssetPath("@nothing")),
]

NAMES = ["points", "curveVertexCounts", "widths", "type", "basis", "wrap", "xformOpOrder", "xformOp:translate"]
NAMES += ["primvars:widths", "velocities", "extent", "pbd:mass", "pbd:pin", "xformOp:transform", "visibility"]


def _attribute(file: Path, chance: random.Random) -> str:
    """An attribute of the curves, or of what they are in, of another type or value, perhaps at one time only."""
    stage = _stage(file)
    curves = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.BasisCurves)]
    prim = chance.choice(curves)
    if chance.random() < 0.2:
        prim = prim.GetParent() or prim
    name = chance.choice(NAMES)
    kind, value = chance.choice(VALUES)(chance)
    layer = stage.GetRootLayer()
    spec = layer.GetPrimAtPath(prim.GetPath())
    if name in spec.properties:
        if chance.random() < 0.4:
            kind = spec.attributes[name].typeName
        when = chance.random() < 0.5
        with contextlib.suppress(Tf.ErrorException, RuntimeError, TypeError):  # USD refuses some of it itself
            if when:
                layer.SetTimeSample(f"{prim.GetPath()}.{name}", chance.choice([-1.0, 1.0, 2.0, 3.5, 1e300]), value)
            else:
                del spec.properties[name]
                Sdf.AttributeSpec(spec, name, kind).default = value
    else:
        with contextlib.suppress(Tf.ErrorException, RuntimeError):
            Sdf.AttributeSpec(spec, name, kind).default = value
    layer.Export(str(file))
    return f"{prim.GetPath()}.{name} = {kind} {str(value)[:40]}"


def _metadata(file: Path, chance: random.Random) -> str:
    stage = _stage(file)
    number = chance.choice([0.0, -1.0, 1e300, 1e-300, float("nan"), float("inf"), 24.0, 1e9])
    key = chance.choice(["timeCodesPerSecond", "startTimeCode", "endTimeCode", "metersPerUnit", "upAxis", "subLayers"])
    layer = stage.GetRootLayer()
    if key == "upAxis":
        layer.pseudoRoot.SetInfo("upAxis", chance.choice(["X", "", "W", "Z"]))
    elif key == "subLayers":
        layer.subLayerPaths.append(chance.choice(["./in.usda", "./none.usda", "/dev/null", "@", "http://x/y.usda"]))
    else:
        layer.pseudoRoot.SetInfo(key, number)
    layer.Export(str(file))
    return f"{key} {number}"


def _bytes(file: Path, chance: random.Random) -> str:
    """Bytes changed, or the end cut off."""
    _stage(file).GetRootLayer().Export(str(file))
    content = bytearray(file.read_bytes())
    if chance.random() < 0.2:
        del content[chance.randrange(len(content)) :]
    for _ in range(chance.choice([1, 1, 1, 5, 50])):
        if content:
            content[chance.randrange(len(content))] = chance.randrange(256)
    file.write_bytes(content)
    return "bytes"


def _line(file: Path, chance: random.Random) -> str:
    """A line of the text taken away, doubled, or put elsewhere."""
    lines = STAGE.read_text().splitlines(keepends=True)
    at = chance.randrange(len(lines))
    line = lines[at]
    if chance.random() < 0.7:
        del lines[at]
    if chance.random() < 0.6:
        lines.insert(chance.randrange(len(lines)), line)
    file.with_suffix(".usda").write_text("".join(lines))
    if file.suffix != ".usda":
        file.with_suffix(".usda").rename(file)
    return f"line {at}: {line.strip()[:60]}"


# Recordings.


def check_drags(processes: Processes, folder: Path, count: int, seed: int = 0) -> Iterator[tuple[str, str]]:
    chance = random.Random(seed)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    ended = processes.call(cwd=folder, code=RECORDS)
    assert ended.code == 0, ended.err
    ended = processes.call("run", "worm", "--drags", "whole.json", "--out", "out.usda", "--frames", 5, cwd=folder)
    assert ended.code == 0, ended.err
    text = (folder / "whole.json").read_text()
    for number in range(count):
        (folder / "out.usda").unlink(missing_ok=True)
        if chance.random() < 0.3:
            content = bytearray(text.encode())
            for _ in range(chance.choice([1, 1, 3])):
                content[chance.randrange(len(content))] = chance.randrange(256)
            said = "bytes"
        else:
            data = json.loads(text)
            said = _mutate(data, chance)
            content = json.dumps(data).encode()
        (folder / "d.json").write_bytes(content)
        ended = processes.call("run", "worm", "--drags", "d.json", "--out", "out.usda", "--frames", 5, cwd=folder)
        yield f"{number}: {said}", ended.complaint or _wrong_outputs(folder, ended)


RECORDS = """
from pathlib import Path
import pbd_warp as pbd
from pbd_warp.grab.recording import Recording, summary
scene = pbd.load_scene("worm")
model = scene.builder.finalize()
recording = Recording("worm", None, {}, summary(model), "float32", scene.settings, 8)
for event in ((0, "select", 3), (1, "move", [0.1, 0.2, 0.3]), (2, "settings", scene.settings.changed(damping=0.5)),
              (3, "move", [0.2, 0.2, 0.3]), (4, "deselect", None)):
    recording.note(*event)
recording.save(Path("whole.json"))
"""

JSONS = [None, True, -1, 0, 1, 10**30, 1e308, float("nan"), float("inf"), "", "x", [], [1], {}, {"x": 1}, [[[]]], "1e9"]


def _mutate(data: Any, chance: random.Random) -> str:
    """Change one value somewhere in nested lists and tables."""
    where = []
    while True:
        keys = list(data) if isinstance(data, dict) else list(range(len(data)))
        if not keys:
            return "nothing"
        key = chance.choice(keys)
        where.append(str(key))
        if isinstance(data[key], (dict, list)) and data[key] and chance.random() < 0.8:
            data = data[key]
            continue
        if chance.random() < 0.2:
            del data[key]
            return f"{'.'.join(where)} taken away"
        data[key] = chance.choice(JSONS)
        return f"{'.'.join(where)} = {data[key]!r}"


def _wrong_outputs(folder: Path, ended: Ended, others: Container[str] = ()) -> str:
    """What is wrong with what a command has left: an output that does not open or is not finite, litter, silence.

    others: Names of what is no animation, whatever it ends in.
    """
    for path in folder.rglob("*"):
        if str(path.relative_to(folder)) in others:
            continue
        if path.suffix in (".usda", ".usdc", ".usd") and path.name.startswith("out") and path.is_file():
            try:
                stage = Usd.Stage.Open(str(path))
            except Tf.ErrorException:
                return f"{path.name} does not open"
            for prim in stage.Traverse():
                if prim.IsA(UsdGeom.PointBased):
                    boundable = UsdGeom.PointBased(prim)
                    for attribute in (
                        boundable.GetPointsAttr(),
                        boundable.GetVelocitiesAttr(),
                        boundable.GetExtentAttr(),
                    ):
                        if any(not np.isfinite(np.array(attribute.Get(t))).all() for t in attribute.GetTimeSamples()):
                            return f"{path.name} is not finite: {attribute.GetPath()}"
        if path.name.startswith(".") or ".new" in path.name or path.name.endswith(".frames"):
            return f"litter: {path.name}"
    return "" if ended.code or ended.out.strip() else "it ends with 0 and says nothing"
