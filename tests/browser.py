"""A session that is served from a thread, and pages of it in headless Chromium."""

import asyncio
import contextlib
import shutil
import threading
import time

import numpy as np

from pbd_warp.view.server import ViewServer

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-gpu-compositing"]
"""WebGL without a GPU; without a sandbox because in a container one is root."""

PATIENCE = 20_000  # ms


@contextlib.contextmanager
def served(session):
    """The session's server, running in a thread of its own."""
    started = threading.Event()
    loop = asyncio.new_event_loop()
    server = ViewServer(session)
    stop = asyncio.Event()

    async def serve():
        await server.start()
        started.set()
        await stop.wait()
        await server.stop()

    thread = threading.Thread(target=lambda: loop.run_until_complete(serve()))
    thread.start()
    assert started.wait(30)
    try:
        yield server
    finally:
        loop.call_soon_threadsafe(stop.set)
        thread.join()
        loop.close()


class Page:
    """A page of a server, and what a user does on it."""

    def __init__(self, context, server, ready=True):
        self.page = context.new_page()
        self.page.set_default_timeout(PATIENCE)
        self.errors = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: message.type == "error" and self.errors.append(message.text))
        self.page.goto(server.url)
        if ready:
            self.until("pbd.ready && pbd.frame > 0")

    def until(self, condition):
        """Wait for a condition on `pbd` (view.js) and the document."""
        self.page.wait_for_function(f"() => window.pbd && ({condition})")

    def wait_for(self, condition):
        """Wait for a condition in Python."""
        end = time.monotonic() + PATIENCE / 1000
        while not condition():
            assert time.monotonic() < end, "waited in vain"
            self.page.wait_for_timeout(20)

    def get(self, expression):
        return self.page.evaluate(expression)

    def positions(self):
        """What is drawn [m], [particle_count, 3]."""
        return np.reshape(self.get("pbd.positions"), (-1, 3))

    def place(self, particle):
        """Where a particle is in the window [px]."""
        return tuple(self.get(f"pbd.project({particle})"))

    def pause(self):
        self.page.keyboard.press("Space")
        self.until("pbd.paused")

    def go_on(self):
        self.page.keyboard.press("Space")
        self.until("!pbd.paused")

    def click_on(self, particle):
        """Take hold of it. What moves is stopped meanwhile: a script's mouse comes later than it looks."""
        moving = not self.get("pbd.paused")
        if moving:
            self.pause()
        self.until("pbd.shown === pbd.frame")
        self.page.mouse.click(*self.place(particle))
        self.until(f"pbd.held === {particle} && pbd.holder === pbd.me")
        if moving:
            self.go_on()

    def lead(self, path):
        """Hover along places in the window [px], about one an animation frame, no button held."""
        for x, y in path:
            self.page.mouse.move(x, y)
            self.page.wait_for_timeout(12)

    def until_under(self, particle, x, y):
        """Wait until the particle is within a pixel of a place in the window."""
        self.until(f"(([x, y]) => Math.hypot(x - {x}, y - {y}) <= 1)(pbd.project({particle}))")

    def frames(self, count):
        """Let so many more frames arrive."""
        self.until(f"pbd.frame >= {self.get('pbd.frame') + count}")
