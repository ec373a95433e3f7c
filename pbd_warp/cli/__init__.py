"""The command line: pbd-warp list | run | info | chart | stability. A command is one file here and one name below."""

import warp as wp

from pbd_warp.cli import chart, info, list, run, stability  # noqa: F401 each adds itself to the application
from pbd_warp.cli.app import app


def main() -> None:
    """Entry point of the `pbd-warp` command."""
    wp.config.log_level = wp.LOG_ERROR  # the banner and compile times of Warp: ours are in the table
    app()
