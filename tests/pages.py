"""Pages of a live view without a browser."""

import asyncio
import contextlib
import json
import time

import aiohttp
import numpy as np

import pbd_warp as pbd
from pbd_warp.view.server import ViewServer
from pbd_warp.view.session import HEADER, Session


def session_of(name="worm", **settings):
    return Session(pbd.load_scene(name), name, **settings)


@contextlib.asynccontextmanager
async def serving(session=None, **options):
    """A server whose first simulation is there."""
    server = ViewServer(session or session_of(), **options)
    await server.start()
    try:
        await server.begun
        yield server
    finally:
        await server.stop()


class Client:
    """A page. It draws what it gets at once, unless told not to."""

    def __init__(self, socket, draws=True):
        self.socket, self.draws = socket, draws
        self.me = self.status = self.scene = self.busy = None
        self.said, self.frames, self.waited = [], [], []
        self.remedies = []
        self.reason = None

    async def listen(self):
        while True:
            message = await self.socket.receive()
            if message.type is aiohttp.WSMsgType.CLOSE:
                self.reason = message.extra
            if message.type not in (aiohttp.WSMsgType.TEXT, aiohttp.WSMsgType.BINARY):
                break
            await self.take(message.data)

    async def take(self, data):
        if isinstance(data, bytes):
            generation, frame, held, holder, *target = HEADER.unpack(data[: HEADER.size])
            count = len(self.scene["radius"]) if self.scene else 0
            x = np.frombuffer(data[HEADER.size :], np.float32)[: 3 * count].reshape(-1, 3)
            self.frames.append((generation, frame, held, holder, x, target))
            if self.draws:
                await self.say("seen", count=len(self.frames))
            return
        message = json.loads(data)
        kind = message.pop("type")
        if kind == "hello":
            self.me = message["you"]
        elif kind == "said":
            self.said.append(message["text"])
            self.remedies = message["remedies"]
        else:
            setattr(self, kind, message)
            if kind == "busy":
                self.waited.append(message)

    async def say(self, kind, **fields):
        await self.socket.send_str(json.dumps({"type": kind, **fields}))

    async def select(self, particle):
        """The particle, as it is seen in the newest frame."""
        generation, frame = self.frames[-1][:2]
        await self.say("select", particle=particle, frame=frame, generation=generation)

    async def until(self, condition, seconds=10.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "waited in vain"
            await asyncio.sleep(0.005)

    @property
    def frame(self):
        return self.frames[-1][1] if self.frames else -1


@contextlib.asynccontextmanager
async def page(server, draws=True, origin=None, address=None):
    """A page as its own origin sees it, unless told otherwise."""
    origin = origin or f"http://{server.url.split('/')[2]}"
    async with aiohttp.ClientSession() as session:
        connecting = session.ws_connect((address or server.url) + "ws", headers={"Origin": origin}, max_msg_size=0)
        async with connecting as socket:
            client = Client(socket, draws)
            listening = asyncio.create_task(client.listen())
            try:
                yield client
            finally:
                listening.cancel()
