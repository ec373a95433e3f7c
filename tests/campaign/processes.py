"""Commands in processes of their own, forked from one that has everything loaded, so that thousands are affordable.

Whatever a command does to its process, a crash or a hang, is seen from outside and harms nobody else.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

HANG = 10.0
"""Seconds after which a command counts as hanging."""

CALLS = "rename,renameat,renameat2,unlink,unlinkat,rmdir,mkdir"
SYNCS = "fsync,fdatasync"
"""System calls at which a command can be killed: what changes names, and what brings data to the disk."""

WORKER = """
import ctypes, json, os, resource, sys, traceback
import warp as wp
wp.config.log_level = wp.LOG_ERROR
import pbd_warp.cli, pbd_warp.curves, pbd_warp.usd.writer
for warm in json.loads(sys.argv[1]):
    pbd_warp.Simulation(pbd_warp.load_scene(warm).builder.finalize(), pbd_warp.load_scene(warm).settings).step()

def job(job):
    os.chdir(job["cwd"])
    for number, name in enumerate(("out", "err"), 1):
        os.dup2(os.open(job[name], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    if job["wait"]:
        ctypes.CDLL(None).prctl(0x59616D61, -1, 0, 0, 0)  # PR_SET_PTRACER: strace is no relative
        os.read(waiting[0], 1)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.argv = ["pbd-warp", *(os.fsdecode(bytes.fromhex(a)) for a in job["arguments"])]
    try:
        if job["code"]:
            exec(job["code"], {"__name__": "job"})
        else:
            pbd_warp.cli.main()
        code = 0
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
        code = 99
    try:
        sys.stdout.flush(); sys.stderr.flush()
    finally:
        os._exit(code)

for line in sys.stdin:
    request = json.loads(line)
    waiting = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(waiting[1])
        job(request)
    os.close(waiting[0])
    print(pid, flush=True)
    if request["wait"]:
        sys.stdin.readline()
        os.write(waiting[1], b"g")
    os.close(waiting[1])
    print(os.waitpid(pid, 0)[1], flush=True)
"""


@dataclass(frozen=True)
class Ended:
    """How a command ended. code: Its exit code; minus the signal that ended it."""

    code: int
    out: str
    err: str
    seconds: float

    @property
    def last_line(self) -> str:
        return (self.err.strip().splitlines() or [""])[-1]

    @property
    def complaint(self) -> str:
        """What is wrong with how it ended, whatever it was asked: empty if nothing."""
        if self.seconds > HANG:
            return "hang"
        if self.code < 0:
            return f"crash: signal {-self.code}"
        if "Traceback (most recent call last)" in self.err or self.code == 99:
            return f"traceback: {self.last_line}"
        if "should have been a clearer sentence" in self.err:
            return f"no clear sentence: {self.last_line}"
        if self.code and not re.search(r"^(pbd-warp|Error): ", self.err, re.MULTILINE):
            return f"no sentence: {self.last_line}"
        if self.code not in (0, 1, 2, 130):
            return f"exit code {self.code}"
        return ""


class Processes:
    """Runs commands of pbd-warp, one after the other; a context manager.

    Args:
        warm: Scenes whose kernels are loaded beforehand.
    """

    def __init__(self, warm: tuple[str, ...] = ("worm",)):
        self._warm = warm
        self._files = Path(tempfile.mkdtemp(prefix="campaign"))
        self._start()

    def _start(self) -> None:
        self._worker = subprocess.Popen(
            [sys.executable, "-c", WORKER, json.dumps(self._warm)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=Path(__file__).parents[2],
        )

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *error: object) -> None:
        self._worker.stdin.close()
        self._worker.wait()
        shutil.rmtree(self._files)

    def call(self, *arguments: object, cwd: Path, code: str = "", kill: tuple[str, int] | None = None) -> Ended:
        """Run a command.

        Args:
            code: Python to run in its place.
            kill: System calls, and at which of them (counted from 1) the command is killed, by strace.
        """
        raw = [os.fsencode(str(argument)).hex() for argument in arguments]
        files = {"out": str(self._files / "out"), "err": str(self._files / "err")}
        job = {"arguments": raw, "cwd": str(cwd), "code": code, "wait": kill is not None, **files}
        begin = time.monotonic()
        pid = int(self._ask(json.dumps(job)))
        tracer = None
        if kill is not None:
            tracer = strace(pid, f"inject={kill[0]}:signal=KILL:when={kill[1]}")
            self._worker.stdin.write("go\n")
            self._worker.stdin.flush()
        timer = None
        try:
            watch = f"import os,time; time.sleep({HANG + 1.0}); os.kill({pid}, {int(signal.SIGKILL)})"
            timer = subprocess.Popen([sys.executable, "-S", "-c", watch], stderr=subprocess.DEVNULL)
            status = int(self._worker.stdout.readline())
        finally:
            if timer is not None:
                timer.kill()
                timer.wait()
        seconds = time.monotonic() - begin
        if tracer is not None:
            tracer.wait()
        texts = {name: Path(file).read_bytes().decode(errors="replace") for name, file in files.items()}
        return Ended(os.waitstatus_to_exitcode(status), seconds=seconds, **texts)

    def count(self, calls: str, *arguments: object, cwd: Path) -> int:
        """How many of some system calls a command makes in one thread, at most."""
        log = self._files / "log"
        job = {"arguments": [os.fsencode(str(a)).hex() for a in arguments], "cwd": str(cwd), "code": "", "wait": True}
        pid = int(self._ask(json.dumps({**job, "out": os.devnull, "err": os.devnull})))
        tracer = strace(pid, f"trace={calls}", "-o", str(log))
        self._worker.stdin.write("go\n")
        self._worker.stdin.flush()
        self._worker.stdout.readline()
        tracer.wait()
        by_thread: dict[str, int] = {}
        for line in log.read_text(errors="replace").splitlines():
            if "(" in line and "resumed>" not in line:
                thread = line.split()[0]
                by_thread[thread] = by_thread.get(thread, 0) + 1
        return max(by_thread.values(), default=0)

    def _ask(self, request: str) -> str:
        self._worker.stdin.write(request + "\n")
        self._worker.stdin.flush()
        return self._worker.stdout.readline()


def strace(pid: int, expression: str, *more: str) -> subprocess.Popen:
    """Attached to a process, which waits for that."""
    arguments = ["strace", "-f", "-qq", "-e", expression, *more, "-p", str(pid)]
    tracer = subprocess.Popen(arguments, stderr=subprocess.DEVNULL)
    status = Path(f"/proc/{pid}/status")
    while "TracerPid:\t0" in status.read_text():
        if tracer.poll() is not None:
            raise RuntimeError("strace does not attach")
        time.sleep(0.001)
    return tracer


def may_trace() -> bool:
    """Whether commands can be killed by strace here."""
    if not shutil.which("strace"):
        return False
    with subprocess.Popen(["sleep", "30"]) as sleeper:
        try:
            strace(sleeper.pid, "trace=none")
        except RuntimeError:
            return False
        finally:
            sleeper.kill()
    return True
