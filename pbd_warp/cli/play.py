"""pbd-warp play."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from pbd_warp.cli.app import command
from pbd_warp.cli.options import Debug
from pbd_warp.cli.terminal import interruptible, one_sentence
from pbd_warp.player.serve import PageServer
from pbd_warp.player.stage import read_motion
from pbd_warp.player.writer import check_player_path
from pbd_warp.progress import progress_bar


@command("play", "play rope.usda", "play sim.usdc --out sim.mp4")
def play(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A .usda, .usdc, .usd or .usdz file.")],
    out: Annotated[
        Path | None, typer.Option(help="Write it to this .html, .mp4 or .gif instead of opening the browser.")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the page; 0 for any that is free.")] = 0,
    no_open: Annotated[bool, typer.Option("--no-open", help="Don't open the browser.")] = False,
    debug: Debug = False,
) -> None:
    """Play a USD animation in the browser: any file of ours, and the points and curves of other stages."""
    with one_sentence(debug), interruptible() as stop_if_asked:
        if out is not None:
            check_player_path(out)
        motion, hidden = read_motion(file)
        if hidden:
            names = ", ".join(f"{count} {name}" for name, count in hidden.items())
            typer.echo(f"not shown: {names}", err=True)
        if out is not None:
            with progress_bar(motion.title) as advance:
                motion.save(out, lambda done, of: (advance(done, of), stop_if_asked()))
            typer.echo(f"{motion.frame_count} frames: {out}")
            return
        server = PageServer(motion.html(), port)
        typer.echo(f"{motion.title} plays at {server.url} (Ctrl-C ends it)")
        if not no_open:
            server.open_browser()
        try:
            while True:
                time.sleep(0.2)
                stop_if_asked()
        except KeyboardInterrupt:
            server.close()
