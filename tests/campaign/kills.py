"""Kills at every system call that changes a name or syncs: what goes on from there ends byte-equal."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pxr import Usd, UsdGeom

from campaign.processes import CALLS, SYNCS, Processes

STAGE = Path(__file__).parents[1] / "data" / "cables_blender.usda"


@dataclass(frozen=True)
class Case:
    """A command that leaves checkpoints: how it begins, and how much it makes in all."""

    name: str
    suffix: str
    start: tuple[str, ...]

    @property
    def arguments(self) -> list[str]:
        return [*self.start, "--out", f"a{self.suffix}", "--checkpoint", "c.npz"]


CASES = [
    *(Case("run", suffix, ("run", "worm", "--frames", "135", "--every", "27")) for suffix in (".usda", ".usdc")),
    Case("simulate", ".usda", ("simulate", "in.usda", "--substeps", "2", "--frames", "75", "--every", "29")),
]


def check(processes: Processes, case: Case, folder: Path, stride: int = 1) -> Iterator[tuple[str, str]]:
    """Kill a command, and in a second series its resumption, at every `stride`-th call; gives (moment, complaint)."""
    whole = fresh(folder / "whole")
    assert processes.call(*case.arguments, cwd=whole).code == 0
    expected = whole / f"a{case.suffix}"
    unfinished = _unfinished(processes, case, folder)
    resumed = [*case.arguments, "--resume"]
    for begun, arguments in (None, case.arguments), (unfinished, resumed):
        for kind in CALLS, SYNCS:
            count = processes.count(kind, *arguments, cwd=fresh(folder / "counted", begun))
            for number in range(1, count + 1, stride):
                work = fresh(folder / "work", begun)
                ended = processes.call(*arguments, cwd=work, kill=(kind, number))
                moment = f"{case.name}{case.suffix} {'resumed' if begun else 'begun'}, {kind.split(',')[0]}... {number}"
                if ended.code != -9:
                    yield moment, "" if ended.code == 0 else f"not killed but ended with {ended.code}: {ended.err}"
                    continue
                yield moment, _gone_on(processes, case, work, expected)


def _unfinished(processes: Processes, case: Case, folder: Path) -> Path:
    """What a kill leaves at the last moment: a checkpoint, and frames far beyond it."""
    calls = processes.count(CALLS, *case.arguments, cwd=fresh(folder / "counted"))
    for number in range(calls, 0, -1):
        left = fresh(folder / "unfinished")
        processes.call(*case.arguments, cwd=left, kill=(CALLS, number))
        if not (left / f"a{case.suffix}").exists():
            return left
    raise AssertionError("it is always whole")


def _gone_on(processes: Processes, case: Case, work: Path, whole: Path) -> str:
    """What is wrong with what a kill has left, or when the command is run again."""
    out, expected = work / whole.name, whole.read_bytes()
    if out.exists() and out.read_bytes() != expected:
        return "the file under the name asked for is not the whole one"
    unfinished = work / f"a.partial{case.suffix}"
    if unfinished.exists() and not _shows_first_frames(unfinished, whole):
        return "the unfinished stage has a gap"
    more = ["--resume"] if (work / "c.npz").exists() else []
    ended = processes.call(*case.arguments, *more, cwd=work)
    if ended.code:
        return f"it does not go on: {ended.err.strip()}"
    if out.read_bytes() != expected:
        return "what went on is not byte-equal"
    left = sorted(path.name for path in work.iterdir() if path.name != "in.usda")
    return "" if left == [out.name, "c.npz"] else f"litter: {left}"


def _shows_first_frames(unfinished: Path, whole: Path) -> bool:
    """Whether a stage shows the frames of another from the first on, without a gap."""
    stage, expected = (Usd.Stage.Open(str(path)) for path in (unfinished, whole))
    checked = 0
    for prim in stage.Traverse():
        points = UsdGeom.PointBased(prim).GetPointsAttr() if prim.IsA(UsdGeom.PointBased) else None
        times = points.GetTimeSamples() if points else []
        if len(times) > 1:
            other = expected.GetAttributeAtPath(points.GetPath())
            checked += 1
            if times != other.GetTimeSamples()[: len(times)] or any(points.Get(t) != other.Get(t) for t in times):
                return False
    return checked > 0


def fresh(folder: Path, like: Path | None = None) -> Path:
    """The folder anew, with the input, or as another one is."""
    shutil.rmtree(folder, ignore_errors=True)
    if like is not None:
        shutil.copytree(like, folder)
    else:
        folder.mkdir(parents=True)
        shutil.copy(STAGE, folder / "in.usda")
    return folder
