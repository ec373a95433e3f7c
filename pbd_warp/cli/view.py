"""pbd-warp view."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import threading
import webbrowser
from pathlib import Path
from typing import Annotated, Any

import typer

from pbd_warp.cli.app import command
from pbd_warp.cli.options import (
    Debug,
    Device,
    Dtype,
    SceneName,
    Seed,
    Set,
    parameters_of,
    scene_file,
    scene_with,
    takes_settings,
)
from pbd_warp.cli.terminal import one_sentence
from pbd_warp.errors import InputError
from pbd_warp.paths import check_apart, check_file
from pbd_warp.view.server import ViewServer
from pbd_warp.view.session import Session


@command("view", "view rope", "view rope --record drags.json", "view my_scene.py --no-open")
@takes_settings
def view(
    scene: SceneName,
    host: Annotated[str, typer.Option(help="Address to listen on; others than this let other machines in.")] = (
        "127.0.0.1"
    ),
    port: Annotated[int, typer.Option(help="First port to try; a busy one gives the next free one, 0 any.")] = 8417,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME:PORT", help="Another name that the page is reached by, as behind a tunnel."),
    ] = None,
    token: Annotated[
        bool, typer.Option("--token", help="Put a random token in the address; it then works under any name.")
    ] = False,
    no_open: Annotated[bool, typer.Option("--no-open", help="Don't open the browser.")] = False,
    record: Annotated[
        Path | None, typer.Option(help="Write what was done to this JSON file, for `run --drags`.")
    ] = None,
    device: Device = None,
    dtype: Dtype = None,
    seed: Seed = None,
    set_: Set = None,
    debug: Debug = False,
    *,
    changes: dict[str, Any],
) -> None:
    """Run a scene live in the browser, where the mouse drags its particles."""
    with one_sentence(debug):
        if not 0 <= port <= 65535:
            raise InputError(f"--port must be in 0..65535, not {port}")
        if record is not None:
            check_apart({"the scene": scene_file(scene)}, {"--record": [check_file(record)]})
        built = scene_with(scene, changes, seed, set_)
        session = Session(built, scene, device, dtype or "float32", seed, parameters_of(set_))
        server = ViewServer(session, host, port, allow_host or (), token)
        asyncio.run(_serve(server, no_open, record))


async def _serve(server: ViewServer, no_open: bool, record: Path | None) -> None:
    """Until Ctrl-C, which is how one ends it, or the terminal is closed."""
    asked, session = server.port, server.session
    await server.start()
    try:
        if asked not in (0, server.port):
            typer.echo(f"port {asked} is busy: took {server.port}")
        if not server.access.loopback:
            typer.echo(
                f"warning: everybody who can reach {server.host} and knows the token can act on the scene", err=True
            )
        typer.echo(f"{session.scene.name} is live at {server.url} (Ctrl-C ends it)")
        for url in server.urls[1:]:
            typer.echo(f"from other machines: {url}")
        if not no_open:
            threading.Thread(target=webbrowser.open, args=(server.url,), daemon=True).start()
        stop = asyncio.Event()
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            with contextlib.suppress(AttributeError, NotImplementedError):  # not all are everywhere
                asyncio.get_running_loop().add_signal_handler(getattr(signal, name), stop.set)
        stopped = asyncio.ensure_future(stop.wait())
        begun: asyncio.Future[Any] = server.begun
        await asyncio.wait([stopped, begun], return_when=asyncio.FIRST_COMPLETED)
        if server.begun.done():
            server.begun.result()  # a scene that cannot be simulated like this
        await asyncio.wait([stopped, server.task], return_when=asyncio.FIRST_COMPLETED)
        if server.task.done():
            server.task.result()  # a mistake of ours must not leave a server that does nothing
    finally:
        await server.stop()
        if record is not None and server.begun.done() and not server.begun.exception():
            session.recording.save(record)
            typer.echo(f"{session.recording.frames} frames of scene {session.scene.name} are recorded in {record}")
