"""Compiles the C loops that the benchmarks compare with, and times calls."""

import ctypes
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import warp as wp


def compile_c(source: str, *options: str) -> ctypes.CDLL:
    """The C file of that name in this folder as a library, by `gcc -O3 -march=native -ffast-math`."""
    if not shutil.which("gcc"):
        sys.exit("this benchmark compares with C: install gcc first")
    library = Path(tempfile.mkdtemp()) / "plain.so"
    path = Path(__file__).with_name(source)
    flags = ["-O3", "-march=native", "-ffast-math", "-shared", "-fPIC", *options]
    subprocess.run(["gcc", *flags, str(path), "-o", str(library), "-lm"], check=True)
    return ctypes.CDLL(str(library))


def timed(call, repeats: int) -> float:
    """Seconds a call takes, over so many of them."""
    start = time.perf_counter()
    for _ in range(repeats):
        call()
    wp.synchronize()
    return (time.perf_counter() - start) / repeats
