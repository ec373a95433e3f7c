"""One page on the network: what waits to be sent to it, and how much it may say."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from aiohttp import web

IN_FLIGHT = 3
"""Frames on their way to a page. It gets no more before it has said that they are there, and then the newest: what a
page has not got is never kept for it, in no buffer on the way either."""

MESSAGES_A_SECOND, BURST = 300.0, 600.0
"""What a page may say in the long run, and at once. One that says more is dropped."""

LONGEST_SENTENCE = 300


@dataclass(eq=False)
class Connection:
    """Of everything to be sent only the newest waits, so nothing grows when the page does not read."""

    number: int
    socket: web.WebSocketResponse
    waiting: dict[str, str] = field(default_factory=dict)
    packet: bytes | None = None
    said: deque[str] = field(default_factory=lambda: deque(maxlen=8))
    greeted: bool = False
    sent: int = 0
    seen: int = 0
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    _allowance: float = BURST
    _heard: float = 0.0

    def put(self, kind: str, fields: dict[str, Any]) -> None:
        """Send a message; one of the same kind that still waits is dropped."""
        self.waiting[kind] = json.dumps({"type": kind, **fields})
        self.wake.set()

    def say(self, text: str, remedies: list[dict[str, Any]] | None = None) -> None:
        """Show a sentence on the page, with buttons."""
        short = text if len(text) <= LONGEST_SENTENCE else text[:LONGEST_SENTENCE] + "..."
        self.said.append(json.dumps({"type": "said", "text": short, "remedies": remedies or []}))
        self.wake.set()

    def arrived(self, count: int) -> None:
        """The page says that it has got so many frames."""
        if self.seen <= count <= self.sent:
            self.seen = count
            self.wake.set()

    def says_too_much(self, now: float) -> bool:
        """Whether one more message at a time [s] is too many."""
        self._allowance = min(BURST, self._allowance + MESSAGES_A_SECOND * (now - self._heard)) - 1.0
        self._heard = now
        return self._allowance < 0.0

    async def send(self, note_sent: Callable[[int], object]) -> None:
        """Send what waits, as fast as the page takes it, until it goes."""
        with contextlib.suppress(ConnectionError, RuntimeError):
            while True:
                await self.wake.wait()
                self.wake.clear()
                while self.said:
                    await self.socket.send_str(self.said.popleft())
                for kind in list(self.waiting):
                    await self.socket.send_str(self.waiting.pop(kind))
                if self.packet and self.sent - self.seen < IN_FLIGHT:
                    packet, self.packet = self.packet, None
                    self.sent += 1
                    note_sent(self.sent)
                    await self.socket.send_bytes(packet)
