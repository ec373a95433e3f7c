"""Serves the page and connects it with a session.

One thread simulates, one event loop talks. The loop hands what pages say to the thread and gets a frame back, so a slow
frame never keeps a page waiting, and a slow page never the simulation.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from aiohttp import WSMsgType, web

from pbd_warp import drawing
from pbd_warp.errors import InputError
from pbd_warp.step import loading
from pbd_warp.view import messages as say
from pbd_warp.view.access import Access
from pbd_warp.view.connection import Connection
from pbd_warp.view.pace import Pace
from pbd_warp.view.saving import SAVED, saved_file
from pbd_warp.view.session import Session
from pbd_warp.view.shortage import Shortage
from pbd_warp.view.turn import Outcome, clip_of, take_turn, what_takes_long

ROOMS = (Path(__file__).parent, Path(drawing.__file__).parent)
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
FILES = {path.name: path for room in ROOMS for path in (room / "page").iterdir() if path.suffix in TYPES}
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; "
    "connect-src 'self' ws: wss:; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

MOST_PAGES = 16
STATUS_EVERY = 0.1  # s

MOST_WAITING = 32
"""What pages have asked for and the simulating thread has not done yet; who asks for more is dropped."""

_LAST_COUNTS = (say.Move, say.Release, say.Pause, say.Reset, say.Rewind, say.Change, say.Open)
"""Of several of one kind in a row, all but the last are forgotten; of changes all count, as one."""

_SETS_THE_CLOCK = (say.Change, say.Reset, say.Open, say.Rope)


class ViewServer:
    """A session on the network: pages watch it and act on it. Simulated time begins when the first page is there.

    Args:
        session: What is shown.
        host: Address to bind to. Unless it is a loopback address other machines reach it; then the page's address has
            a random token in it, without which there is nothing to be had.
        port: The first that is tried; a busy one gives the next. 0: any that is free.
        also: Other names under which it is reached; token: whether there is one in any case (see `Access`).

    Attributes:
        port, url, urls: Where the page is, once started; `url` for this machine, `urls` for others too.
        begun: Done when the first simulation is there; an InputError if it is refused. task: Done if it ends.
        frames_sent: Frames sent, by the number of the page.
    """

    def __init__(
        self,
        session: Session,
        host: str = "127.0.0.1",
        port: int = 0,
        also: Sequence[str] = (),
        token: bool = False,
    ):
        self.session, self.access = session, Access(host, also, token)
        self.host, self.port = host, port
        self.frames_sent: dict[int, int] = {}
        self._pages: dict[int, Connection] = {}
        self._waiting: list[tuple[int, say.Message | None]] = []  # None: the page has gone
        self._called = asyncio.Event()
        self._opened = asyncio.Event()
        self._ending = False
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="simulation")
        self._busy: dict[str, Any] = {"text": None, "compiling": None}
        self._runner: web.AppRunner | None = None

    @property
    def urls(self) -> list[str]:
        return self.access.urls()

    @property
    def url(self) -> str:
        return self.urls[0]

    async def start(self) -> None:
        """Bind and serve; the first simulation is built meanwhile.

        Raises:
            InputError: it cannot listen there, or no port from the asked one on is free.
        """
        quiet = logging.getLogger("pbd_warp.view")
        quiet.addHandler(logging.NullHandler())
        quiet.propagate = False  # what strangers send to a port is no news
        app = web.Application(middlewares=[self._guard], logger=quiet)
        for path, handler in ("ws", self._converse), ("save/{name}", self._save), ("{name:[^/]*}", self._file):
            app.router.add_get(self.access.path + path, handler)
        self._runner = web.AppRunner(app, access_log=None, logger=quiet, shutdown_timeout=2.0)
        await self._runner.setup()
        for port in range(self.port, 65536):
            try:
                site = web.TCPSite(self._runner, self.host, port)
                await site.start()
                break
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    await self._runner.cleanup()
                    raise InputError(f"cannot listen on {self.host}, port {port}: {error.strerror or error}") from None
        else:
            raise InputError(f"no port from {self.port} on is free: name a lower one with --port")
        self.port = self.access.port = self._runner.addresses[0][1]
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(Shortage())
        self._tell_loading = lambda what: loop.call_soon_threadsafe(self._set_busy, {"compiling": what})
        loading.listeners.append(self._tell_loading)
        self._set_busy({"text": f"Opening {self.session.scene.name}"})
        self.begun: asyncio.Future[None] = asyncio.ensure_future(loop.run_in_executor(self._thread, self.session.begin))
        self.task = asyncio.create_task(self._simulate())

    async def stop(self) -> None:
        """Close all pages; nothing is simulated after this."""
        if not self._runner or self._ending:
            return
        loading.listeners.remove(self._tell_loading)
        self._ending = True  # besides: up to Python 3.11 wait_for may swallow a cancellation
        self.task.cancel()
        await asyncio.gather(self.task, return_exceptions=True)
        for page in list(self._pages.values()):
            await page.socket.close(code=1001, message=b"ended")
        await self._runner.cleanup()
        self._thread.shutdown(cancel_futures=True)

    def _set_busy(self, fields: dict[str, Any]) -> None:
        """What pages show while nothing moves."""
        self._busy |= fields
        for page in self._pages.values():
            page.put("busy", self._busy)

    async def _simulate(self) -> None:
        """Turn after turn: what pages have asked for, a frame when it is due, and what pages are to be sent."""
        await asyncio.gather(self.begun)
        self._set_busy({"text": None})
        await self._opened.wait()
        loop = asyncio.get_running_loop()
        pace = Pace(self.session.scene.fps, loop.time())
        told = -STATUS_EVERY
        while not self._ending:
            await self._wait_until(pace.due if self.session.running else None)
            commands, self._waiting = self._waiting, []
            self._called.clear()
            new_pages = [page for page in self._pages.values() if not page.greeted]
            now = loop.time()
            asked = any(not isinstance(message, say.Move) for _, message in commands)
            tell = asked or bool(new_pages) or now - told >= STATUS_EVERY
            text = what_takes_long(commands)
            if text:
                self._set_busy({"text": text})
            outcome = await loop.run_in_executor(
                self._thread, take_turn, self.session, commands, now >= pace.due, tell, bool(new_pages)
            )
            if text:
                self._set_busy({"text": None})
            now = loop.time()
            if outcome.made:
                pace.made(now)
            if not self.session.running or any(isinstance(message, _SETS_THE_CLOCK) for _, message in commands):
                pace = Pace(self.session.scene.fps, now)  # time that was not simulated on purpose is not caught up with
            if outcome.status is not None:
                told = now
                outcome.status |= {"speed": pace.speed(now), "keeps_up": pace.keeps_up(now), "pages": len(self._pages)}
            self._publish(outcome, new_pages)

    async def _wait_until(self, due: float | None) -> None:
        """Wait for a page to ask for something, at most until it is time for a frame."""
        timeout = None if due is None else due - asyncio.get_running_loop().time()
        with contextlib.suppress(asyncio.TimeoutError):
            await asyncio.wait_for(self._called.wait(), timeout)

    def _publish(self, outcome: Outcome, new_pages: list[Connection]) -> None:
        for page in new_pages:
            page.greeted = True
        for page in self._pages.values():
            if not page.greeted:
                continue  # it came after this turn began
            if outcome.description and (outcome.changed or page in new_pages):
                page.put("scene", outcome.description)
            if outcome.status:
                page.put("status", outcome.status)
            for note in outcome.notes:
                page.say(note)
            page.packet = outcome.packet
            page.wake.set()
        for who, text, remedies in outcome.refused:
            if who in self._pages:
                self._pages[who].say(text, remedies)

    async def _converse(self, request: web.Request) -> web.WebSocketResponse:
        """With one page, until it goes."""
        if not self.access.is_own_origin(request.headers.getall("Origin", []), request.host):
            raise web.HTTPForbidden(text="Only the page of this server may talk to it.\n")
        if len(self._pages) >= MOST_PAGES:
            raise web.HTTPServiceUnavailable(text="Too many pages are open.\n")
        socket = web.WebSocketResponse(max_msg_size=say.LARGEST, compress=False, timeout=2.0)
        await socket.prepare(request)
        number = len(self.frames_sent) + 1
        page = self._pages[number] = Connection(number, socket)
        self.frames_sent[number] = 0
        page.put("hello", {"you": number})
        page.put("busy", self._busy)
        sender = asyncio.create_task(page.send(lambda sent: self.frames_sent.update({number: sent})))
        self._opened.set()
        self._called.set()
        try:
            async for message in socket:
                if message.type in (WSMsgType.TEXT, WSMsgType.BINARY):
                    reason = self._hear(page, message.data)
                    if reason:
                        await socket.close(code=1008, message=reason.encode())
        finally:
            del self._pages[number]
            sender.cancel()
            self._waiting.append((number, None))
            self._called.set()
        return socket

    def _hear(self, page: Connection, text: str | bytes) -> str | None:
        """Note what a page asks for; a reason for dropping it, or None."""
        if page.says_too_much(asyncio.get_running_loop().time()):
            return "too many messages"
        try:
            message = say.parse(text)
        except InputError as error:
            page.say(f"ignored: {error}")
            return None
        if isinstance(message, say.Seen):
            page.arrived(message.count)
            return None
        mine = [k for k, (who, _) in enumerate(self._waiting) if who == page.number]
        last = self._waiting[mine[-1]][1] if mine else None
        if type(last) is type(message):
            if isinstance(message, say.Change) and isinstance(last, say.Change):
                message = say.Change({**last.changes, **message.changes})
            if isinstance(message, _LAST_COUNTS):
                del self._waiting[mine.pop()]
        if len(mine) >= MOST_WAITING:
            return "too much asked for at once"
        self._waiting.append((page.number, message))
        if not isinstance(message, say.Move):
            self._called.set()  # a move counts when the next frame is made
        return None

    async def _file(self, request: web.Request) -> web.Response:
        """A file of the page."""
        name = request.match_info["name"] or "index.html"
        if name not in FILES:
            raise web.HTTPNotFound(text="There is no such file.\n")
        kind = TYPES[FILES[name].suffix]
        return web.Response(body=FILES[name].read_bytes(), content_type=kind, charset="utf-8")

    async def _save(self, request: web.Request) -> web.Response:
        """The frames that are kept, as a USD file, or what was done, for `run --drags`."""
        name = request.match_info["name"]
        if name not in SAVED:
            raise web.HTTPNotFound(text="There is no such file.\n")
        loop = asyncio.get_running_loop()
        kept, drags = await loop.run_in_executor(self._thread, clip_of, self.session)
        file, body = await asyncio.to_thread(saved_file, name, kept, drags)
        disposition = {"Content-Disposition": f'attachment; filename="{file}"'}
        return web.Response(body=body, content_type=SAVED[name], headers=disposition)

    @web.middleware
    async def _guard(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        """Refuse strangers, and put our headers on everything else."""
        refusal = self.access.refusal(request.rel_url.raw_path, request.headers.getall("Host", []))
        if refusal:
            return web.Response(status=403, text=refusal, headers=HEADERS)
        try:
            response = await handler(request)
        except web.HTTPException as error:
            error.headers.update(HEADERS)
            raise
        if not response.prepared:
            response.headers.update(HEADERS)
        return response
