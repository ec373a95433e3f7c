"""Serves the page and connects it with a session. The only file that needs the extra `view`.

One thread simulates, one event loop talks. The loop hands what pages say to the thread and gets a frame back, so a slow
frame never keeps a page waiting, and a slow page never the simulation.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import logging
import secrets
import socket
import traceback
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from http import HTTPStatus
from ipaddress import ip_address
from pathlib import Path
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from pbd_warp.errors import InputError
from pbd_warp.view import messages as say
from pbd_warp.view.pace import Pace
from pbd_warp.view.session import Session

PAGE = Path(__file__).parent / "page"
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
FILES = {path.name: path for path in PAGE.iterdir() if path.suffix in TYPES}
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; "
    "connect-src 'self' ws:; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

MOST_PAGES = 16
IN_FLIGHT = 3
"""Frames on their way to a page. It gets no more before it has said that they are there, and then the newest: what a
page has not got is never kept for it, in no buffer on the way either."""

STATUS_EVERY = 0.1  # s
MESSAGES_A_SECOND, BURST = 300.0, 600.0
"""What a page may say in the long run, and at once. One that says more is dropped."""

MOST_WAITING = 32
"""What pages have asked for and the simulating thread has not done yet; who asks for more is dropped."""

_LAST_COUNTS = (say.Move, say.Release, say.Pause, say.Reset, say.Change, say.Load)
"""Of several of one kind in a row, all but the last are forgotten; of changes all count, as one."""

LONGEST_SENTENCE = 300


@dataclass(eq=False)
class Page:
    """One page. Of everything to be sent only the newest waits, so nothing grows when the page does not read."""

    number: int
    connection: ServerConnection
    description: str | None = None
    status: str | None = None
    packet: bytes | None = None
    said: deque[str] = field(default_factory=lambda: deque(maxlen=8))
    greeted: bool = False
    sent: int = 0
    seen: int = 0
    allowance: float = BURST
    heard: float = 0.0
    wake: asyncio.Event = field(default_factory=asyncio.Event)

    def say(self, text: str) -> None:
        """Show a sentence on the page."""
        short = text if len(text) <= LONGEST_SENTENCE else text[:LONGEST_SENTENCE] + "..."
        self.said.append(json.dumps({"type": "said", "text": short}))
        self.wake.set()


@dataclass
class Outcome:
    """What the simulating thread has done in one turn. changed: It is another scene now."""

    refused: list[tuple[int, str]]
    made: bool
    packet: bytes
    changed: bool
    description: dict[str, Any] | None
    status: dict[str, Any] | None


class ViewServer:
    """A session on the network: pages watch it and act on it. Simulated time begins when the first page is there.

    Args:
        session: What is shown.
        host: Address to bind to. Unless it is a loopback address other machines reach it; then the page's address has
            a random token in it, without which there is nothing to be had.
        port: The first that is tried; a busy one gives the next. 0: any that is free.

    Attributes:
        port, url: Where the page is, once started.
        frames_sent: Frames sent, by the number of the page.
    """

    def __init__(self, session: Session, host: str = "127.0.0.1", port: int = 0):
        self.session = session
        self.host, self.port = host, port
        self.loopback = _is_loopback(host)
        self._path = "/" if self.loopback else f"/{secrets.token_urlsafe(16)}/"
        self.frames_sent: dict[int, int] = {}
        self._pages: dict[int, Page] = {}
        self._waiting: list[tuple[int, say.Message | None]] = []  # None: the page has gone
        self._called = asyncio.Event()
        self._opened = asyncio.Event()
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="simulation")
        self._task: asyncio.Task[None] | None = None
        self._server: Server | None = None

    @property
    def url(self) -> str:
        host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)
        return f"http://{_bracketed(host)}:{self.port}{self._path}"

    async def start(self) -> None:
        """Bind and serve.

        Raises:
            InputError: it cannot listen there, or no port from the asked one on is free.
        """
        quiet = logging.getLogger("pbd_warp.view")
        quiet.addHandler(logging.NullHandler())
        quiet.propagate = False  # what strangers send to a port is no news
        for port in range(self.port, 65536):
            try:
                self._server = await serve(
                    *(self._converse, self.host, port),
                    process_request=self._answer,
                    compression=None,
                    max_size=say.LARGEST,
                    close_timeout=2.0,
                    logger=quiet,
                )
                break
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    reason = error.strerror or str(error)
                    raise InputError(f"cannot listen on {self.host}, port {port}: {reason}") from None
        else:
            raise InputError(f"no port from {self.port} on is free: name a lower one with --port")
        self.port = next(iter(self._server.sockets)).getsockname()[1]
        self._task = asyncio.create_task(self._simulate())

    async def stop(self) -> None:
        """Close all pages; nothing is simulated after this."""
        if self._task:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)
        if self._server:
            self._server.close()
            await self._server.wait_closed()
        self._thread.shutdown()

    async def _simulate(self) -> None:
        """Turn after turn: what pages have asked for, a frame when it is due, and what pages are to be sent."""
        await self._opened.wait()
        loop = asyncio.get_running_loop()
        pace = Pace(self.session.scene.fps, loop.time())
        told = -STATUS_EVERY
        while True:
            await self._wait_until(pace.due if self.session.running else None)
            commands, self._waiting = self._waiting, []
            self._called.clear()
            new_pages = [page for page in self._pages.values() if not page.greeted]
            now = loop.time()
            asked = any(not isinstance(message, say.Move) for _, message in commands)
            tell = asked or bool(new_pages) or now - told >= STATUS_EVERY
            outcome = await loop.run_in_executor(
                self._thread, self._turn, commands, now >= pace.due, tell, bool(new_pages)
            )
            now = loop.time()
            if outcome.made:
                pace.made(now)
            if not self.session.running or any(
                isinstance(message, (say.Change, say.Reset, say.Load)) for _, message in commands
            ):
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

    def _turn(self, commands: list[tuple[int, say.Message | None]], due: bool, tell: bool, describe: bool) -> Outcome:
        """In the simulating thread, which alone touches the simulation."""
        session = self.session
        before = session.generation
        refused = []
        for who, message in commands:
            try:
                if message is None:
                    session.leave(who)
                else:
                    session.do(who, message)
            except InputError as error:
                refused.append((who, str(error)))
            except Exception as error:  # a mistake of ours, or a device out of memory: pages live on
                traceback.print_exc()
                refused.append((who, f"{type(error).__name__}: {error}"))
        try:
            made = due and session.advance()
        except Exception as error:
            traceback.print_exc()
            session.failure, made = f"{type(error).__name__}: {error}", False
        changed = session.generation != before
        status = session.status() if tell or changed or session.failure is not None else None
        description = session.description() if describe or changed else None
        return Outcome(refused, made, session.packet(), changed, description, status)

    def _publish(self, outcome: Outcome, new_pages: list[Page]) -> None:
        description = outcome.description and json.dumps({"type": "scene", **outcome.description})
        status = outcome.status and json.dumps({"type": "status", **outcome.status})
        for page in new_pages:
            page.greeted = True
        for page in self._pages.values():
            if not page.greeted:
                continue  # it came after this turn began
            if description and (outcome.changed or page in new_pages):
                page.description = description
            page.status = status or page.status
            page.packet = outcome.packet
            page.wake.set()
        for who, text in outcome.refused:
            if who in self._pages:
                self._pages[who].say(text)

    async def _converse(self, connection: ServerConnection) -> None:
        """With one page, until it goes."""
        number = len(self.frames_sent) + 1
        page = self._pages[number] = Page(number, connection)
        self.frames_sent[number] = 0
        sender = asyncio.create_task(self._send(page))
        self._opened.set()
        self._called.set()
        closing: asyncio.Task[None] | None = None
        try:
            async for text in connection:
                if closing:
                    continue  # what is left must be read, or its own goodbye would never come
                reason = self._hear(page, text)
                if reason:
                    closing = asyncio.create_task(connection.close(1008, reason))
        except ConnectionClosed:
            pass
        finally:
            del self._pages[number]
            sender.cancel()
            if closing:
                await closing
            self._waiting.append((number, None))
            self._called.set()

    def _hear(self, page: Page, text: str | bytes) -> str | None:
        """Note what a page asks for; a reason for dropping it, or None."""
        now = asyncio.get_running_loop().time()
        page.allowance = min(BURST, page.allowance + MESSAGES_A_SECOND * (now - page.heard)) - 1.0
        page.heard = now
        if page.allowance < 0.0:
            return "too many messages"
        try:
            message = say.parse(text)
        except InputError as error:
            page.say(f"ignored: {error}")
            return None
        if isinstance(message, say.Seen):
            if page.seen <= message.count <= page.sent:
                page.seen = message.count
                page.wake.set()
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

    async def _send(self, page: Page) -> None:
        """Send one page what waits for it, as fast as it takes it."""
        send = page.connection.send
        with contextlib.suppress(ConnectionClosed):
            await send(json.dumps({"type": "hello", "you": page.number}))
            while True:
                await page.wake.wait()
                page.wake.clear()
                while page.said:
                    await send(page.said.popleft())
                if page.description:
                    text, page.description = page.description, None
                    await send(text)
                if page.status:
                    text, page.status = page.status, None
                    await send(text)
                if page.packet and page.sent - page.seen < IN_FLIGHT:
                    packet, page.packet = page.packet, None
                    page.sent += 1
                    self.frames_sent[page.number] = page.sent
                    await send(packet)

    def _answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file of the page, a refusal, or None for the conversation to begin."""
        hosts, origins = request.headers.get_all("Host"), request.headers.get_all("Origin")
        if len(hosts) != 1 or not self._is_ours(hosts[0]):
            return connection.respond(HTTPStatus.FORBIDDEN, "This is no name of this server.\n")
        path = request.path.partition("?")[0]
        if not secrets.compare_digest(path[: len(self._path)].encode(), self._path.encode()):
            return connection.respond(HTTPStatus.FORBIDDEN, "The address lacks the token that was printed with it.\n")
        name = path[len(self._path) :] or "index.html"
        if name == "ws":
            if origins != [f"http://{hosts[0]}"]:
                return connection.respond(HTTPStatus.FORBIDDEN, "Only the page of this server may talk to it.\n")
            if len(self._pages) >= MOST_PAGES:
                return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "Too many pages are open.\n")
            return None
        if name not in FILES:
            return connection.respond(HTTPStatus.NOT_FOUND, "There is no such file.\n")
        response = connection.respond(HTTPStatus.OK, "")
        response.body = FILES[name].read_bytes()
        for header in ("Content-Type", "Content-Length"):
            del response.headers[header]
        headers = {"Content-Type": f"{TYPES[FILES[name].suffix]}; charset=utf-8", "Content-Length": len(response.body)}
        for header, value in {**headers, **HEADERS}.items():
            response.headers[header] = str(value)
        return response

    def _is_ours(self, host: str) -> bool:
        """Whether a Host header names this server. A page of another name (DNS rebinding) is none of ours."""
        name, colon, port = host.rpartition(":")
        if not colon or not (port.isascii() and port.isdigit() and len(port) <= 5):
            name, port = host, "80"
        if int(port) != self.port:
            return False
        name = name.lower()
        if name in ("localhost", _bracketed(self.host).lower()) or _is_address(name, loopback=True):
            return True
        # Bound to all addresses, which one a page has used is not known; names can be anybody's, addresses cannot.
        return not self.loopback and (name == socket.gethostname().lower() or _is_address(name, loopback=False))


def _is_loopback(host: str) -> bool:
    return host == "localhost" or _is_address(_bracketed(host), loopback=True)


def _is_address(name: str, *, loopback: bool) -> bool:
    """Whether a name as in a URL is an IP address; with `loopback`, of this machine alone."""
    try:
        address = ip_address(name[1:-1] if name.startswith("[") and name.endswith("]") else name)
    except ValueError:
        return False
    return address.is_loopback or not loopback


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host
