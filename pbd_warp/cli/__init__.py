"""The command line: a command is one file here and one name in the import below."""

import warp as wp

# Each adds itself to the application.
from pbd_warp.cli import chart, info, list, play, run, simulate, stability, view  # noqa: F401
from pbd_warp.cli.app import app


def main() -> None:
    """Entry point of the `pbd-warp` command."""
    wp.config.log_level = wp.LOG_ERROR  # the banner and compile times of Warp: ours are in the table
    app()
