"""The command line: a command is one file here and one name in the import below."""

import os
import sys

# Each adds itself to the application.
from pbd_warp.cli import chart, info, list, play, run, simulate, stability, study, view  # noqa: F401
from pbd_warp.cli.app import app
from pbd_warp.quiet import start_warp


def main() -> None:
    """Entry point of the `pbd-warp` command."""
    if "_PBD_WARP_COMPLETE" not in os.environ:  # a shell that asks what may come next
        start_warp(sys.argv[1:])
    app()
