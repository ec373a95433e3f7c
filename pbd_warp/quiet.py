"""Starts Warp without what it says about itself."""

from __future__ import annotations

import os
import sys
import tempfile

import warp as wp

LOUD = ("--debug", "--device")
"""Words of a command line that ask for what Warp says: why a GPU cannot be had, for one."""


def start_warp(arguments: list[str]) -> None:
    """Start Warp, quietly unless the command names a device or asks for details.

    That there is no GPU is printed by Warp's library, past Python: so the file descriptor itself is another one
    for that long. Whatever else was printed there comes out afterwards.
    """
    if any(argument.startswith(LOUD) for argument in arguments):
        return
    wp.config.log_level = wp.LOG_ERROR
    sys.stderr.flush()
    with tempfile.TemporaryFile() as said:
        stderr = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        said.seek(0)
        for line in said.read().decode(errors="replace").splitlines():
            if "GPU execution will not be available" not in line:
                print(line, file=sys.stderr)
