"""The live view on the network: what pages get, what they may say, and who may talk to it at all."""

import asyncio
import contextlib
import json
import logging
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from hypothesis import given
from test_view_messages import CAMERA, odd_texts
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

import pbd_warp as pbd
from pbd_warp.view import messages as say
from pbd_warp.view import server as module
from pbd_warp.view.server import IN_FLIGHT, ViewServer
from pbd_warp.view.session import HEADER, Session


def session_of(name="worm", **settings):
    return Session(pbd.load_scene(name), name, **settings)


@contextlib.asynccontextmanager
async def serving(session=None, **options):
    server = ViewServer(session or session_of(), **options)
    await server.start()
    try:
        yield server
    finally:
        await server.stop()


class Client:
    """A page without a browser. It draws what it gets at once, unless told not to."""

    def __init__(self, socket, draws=True):
        self.socket, self.draws = socket, draws
        self.me = self.status = self.scene = None
        self.said, self.frames = [], []
        self.reason = None

    async def listen(self):
        try:
            async for message in self.socket:
                await self.recording(message)
        except ConnectionClosed:
            pass
        self.reason = self.socket.close_reason

    async def take(self, message):
        if isinstance(message, bytes):
            self.frames.append(
                (*HEADER.unpack(message[: HEADER.size]), np.frombuffer(message[HEADER.size :], np.float32))
            )
            if self.draws:
                await self.say("seen", count=len(self.frames))
            return
        message = json.loads(message)
        kind = message.pop("type")
        if kind == "hello":
            self.me = message["you"]
        elif kind == "said":
            self.said.append(message["text"])
        else:
            setattr(self, kind, message)

    async def say(self, kind, **fields):
        await self.socket.send(json.dumps({"type": kind, **fields}))

    async def until(self, condition, seconds=10.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "waited in vain"
            await asyncio.sleep(0.005)

    @property
    def frame(self):
        return self.frames[-1][1] if self.frames else -1


@contextlib.asynccontextmanager
async def page(server, draws=True, **options):
    address = server.url.replace("http", "ws") + "ws"
    origin = server.url.rstrip("/") if server.loopback else f"http://{server.url.split('/')[2]}"
    async with connect(address, origin=origin, compression=None, max_queue=None, **options) as socket:
        client = Client(socket, draws)
        listening = asyncio.create_task(client.listen())
        try:
            yield client
        finally:
            listening.cancel()


def test_a_page_gets_the_scene_then_frames_and_leads_a_particle():
    async def go():
        async with serving() as server, page(server) as client:
            await client.until(lambda: client.frame > 5)
            assert client.scene["scene"] == "worm"
            assert client.me == 1
            assert len(client.frames[-1][4]) == 3 * 25
            assert client.status["settings"]["method"] == "gauss-seidel"
            assert client.status["pages"] == 1
            at = [400.0, 300.0]  # the head is at the origin
            await client.say("click", camera=CAMERA, at=at)
            await client.until(lambda: client.frames[-1][2:4] == (0, client.me))
            await client.say("move", camera=CAMERA, at=[430.0, 290.0])
            await client.until(lambda: client.frames[-1][4][0] > 0.05)
            await client.say("click", camera=CAMERA, at=at)
            await client.until(lambda: client.frames[-1][2:4] == (-1, 0))
            numbers = [frame[1] for frame in client.frames]
            assert numbers == sorted(numbers)

    asyncio.run(go())


def test_simulated_time_begins_with_the_first_page_and_goes_at_the_scenes_rate():
    async def go():
        async with serving() as server:
            await asyncio.sleep(0.3)
            assert server.session.frame == 0
            async with page(server) as client:
                await client.until(lambda: client.frame > 0)
                start, first = time.monotonic(), client.frame
                await asyncio.sleep(1.5)
                rate = (client.frame - first) / (time.monotonic() - start)
                assert rate < 1.1 * 60.0, "never faster than real time"
                assert rate > 20.0

    asyncio.run(go())


def test_several_watch_one_drags_and_all_are_told():
    async def go():
        async with serving() as server, page(server) as one, page(server) as two:
            await two.until(lambda: two.frame > 0 and one.frame > 0)
            await one.say("click", camera=CAMERA, at=[400, 300])
            await two.until(lambda: two.frames[-1][2:4] == (0, one.me))
            await two.say("click", camera=CAMERA, at=[400, 300])
            await two.until(lambda: two.said)
            assert two.said == [f"page {one.me} is dragging; wait until it lets go"]
            assert one.status["pages"] == 2
            await one.socket.close()
            await two.until(lambda: two.frames[-1][2:4] == (-1, 0))
            await two.say("click", camera=CAMERA, at=[400, 300])
            await two.until(lambda: two.frames[-1][2:4] == (0, two.me))

    asyncio.run(go())


def test_a_stalled_page_slows_nobody_and_gets_the_newest_frame():
    async def go():
        async with serving() as server, page(server, draws=False) as stalled, page(server) as other:
            await other.until(lambda: other.frame > 60)
            sent = server.frames_sent[stalled.me]
            assert sent == len(stalled.frames) == IN_FLIGHT
            assert server.frames_sent[other.me] > 30
            await stalled.say("seen", count=IN_FLIGHT)
            await stalled.until(lambda: len(stalled.frames) == 2 * IN_FLIGHT)
            assert stalled.frames[IN_FLIGHT][1] > 60, "nothing old was kept for it"

    asyncio.run(go())


def test_a_page_that_does_not_read_at_all_slows_nobody():
    """Its socket is full: what waits for it stays as much as it was."""

    async def go():
        async with serving() as server, page(server) as other:
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(
                f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\nOrigin: http://127.0.0.1:{server.port}\r\n"
                "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
                "Sec-WebSocket-Version: 13\r\n\r\n".encode()
            )
            await writer.drain()
            await other.until(lambda: len(server._pages) == 2 and other.frame > 30)
            blocked = server._pages[2]
            start = other.frame
            for _ in range(5):
                for _ in range(50):
                    blocked.say("x" * 300)
                await other.until(lambda before=other.frame: other.frame >= before + 10)
            assert other.frame >= start + 50
            assert server.frames_sent[2] <= IN_FLIGHT
            assert len(blocked.said) <= 8
            writer.close()
            await other.until(lambda: len(server._pages) == 1)
            del reader

    asyncio.run(go())


def test_pause_step_change_and_refusals_reach_the_pages():
    async def go():
        async with serving(session_of("rope")) as server, page(server) as client:
            await client.until(lambda: client.frame > 3)
            await client.say("pause", on=True)
            await client.until(lambda: client.status["paused"])
            frame = server.session.frame
            await client.say("step")
            await client.until(lambda: client.frame == frame + 1)
            await client.say("change", changes={"integrator": "bdf2"})
            await client.until(lambda: client.said)
            assert "'bdf2' does not model damping" in client.said[0]
            await client.say("change", changes={"substeps": 7})
            await client.until(lambda: client.status["settings"]["substeps"] == 7)
            assert server.session.frame == frame + 1
            await client.say("load", scene="point")
            await client.until(lambda: client.scene["scene"] == "point" and client.frames[-1][0] == 2)

    asyncio.run(go())


def test_a_simulation_that_cannot_keep_up_says_so(monkeypatch):
    async def go():
        session = session_of()
        step = session.sim.step
        monkeypatch.setattr(session.sim, "step", lambda: (time.sleep(0.05), step()))
        async with serving(session) as server, page(server) as client:
            await client.until(lambda: client.status and not client.status["keeps_up"])
            assert 0.05 < client.status["speed"] < 0.4
            before = client.frame
            started = time.monotonic()
            await client.say("pause", on=True)
            await client.until(lambda: client.status["paused"])
            assert time.monotonic() - started < 2.0, "it does not spiral: pages are heard between frames"
            assert session.frame - before < 40

    asyncio.run(go())


def test_a_failure_is_told_and_reset():
    async def go():
        builder = pbd.ModelBuilder(gravity=(0, 0, 0))
        builder.add_particle((0, 0, 0), velocity=(3e38, 0, 0))
        session = Session(pbd.Scene(builder, name="far", fps=0.5), "far.py")
        session.do(0, say.Pause(True))
        async with serving(session) as server, page(server) as client:
            for _ in range(4):
                await client.say("step")
            await client.until(lambda: client.status and client.status["failure"])
            assert "particle 0 has left the finite numbers" in client.status["failure"]
            await client.say("reset")
            await client.until(lambda: client.status["failure"] is None and client.status["frame"] == 0)

    asyncio.run(go())


def test_an_error_of_ours_stops_neither_the_server_nor_the_page(monkeypatch, capsys):
    async def go():
        session = session_of()
        async with serving(session) as server, page(server) as client:
            await client.until(lambda: client.frame > 2)
            monkeypatch.setattr(session.sim, "step", lambda: 1 / 0)
            await client.until(lambda: client.status["failure"])
            assert "ZeroDivisionError" in client.status["failure"]
            await client.say("reset")
            await client.until(lambda: client.status["failure"] is None and client.frame > 2)

    asyncio.run(go())
    assert "ZeroDivisionError" in capsys.readouterr().err


# Pages that talk nonsense, or too much


def test_odd_messages_are_ignored_with_a_reason_and_the_simulation_goes_on():
    """Drawn by hypothesis, all over one connection: none stops the frames, the page is not even dropped."""
    texts = []

    @given(odd_texts)
    def draw(text):
        if text != b"":
            texts.append(text)

    draw()

    async def go():
        session = session_of()
        async with serving(session) as server, page(server) as client:
            await client.until(lambda: client.frame > 0)
            for text in texts:
                await client.socket.send(text)
                await asyncio.sleep(0.004)
            before = session.frame
            await client.say("pause", on=False)
            await client.until(lambda: session.frame > before + 5)
            assert client.reason is None
            assert any(sentence.startswith("ignored: ") for sentence in client.said)
            assert session.failure is None

    asyncio.run(go())
    assert len(texts) > 20


@pytest.mark.parametrize(
    ("text", "count", "reason"),
    [
        ('{"type": "release"}', 2000, "too many messages"),
        ("nonsense", 2000, "too many messages"),
        ('{"type": "seen", "count": 0}', 2000, "too many messages"),
        ('{"type": "reset"}', 2000, "too many messages"),
        ("x" * 10_000, 1, ""),
    ],
)
def test_a_page_that_floods_is_dropped_with_a_reason_and_the_others_go_on(text, count, reason):
    async def go():
        session = session_of()
        async with serving(session) as server, page(server) as other, page(server) as rude:
            await other.until(lambda: other.frame > 0 and rude.frame > 0)
            with contextlib.suppress(ConnectionClosed):
                for _ in range(count):
                    await rude.socket.send(text)
            await other.until(lambda: rude.reason is not None)
            assert reason in rude.reason
            assert rude.socket.close_code == (1008 if reason else 1009)
            seen = len(other.frames)
            await other.until(lambda: len(other.frames) > seen + 10)

    asyncio.run(go())


def test_a_page_that_asks_for_more_than_can_be_done_is_dropped(monkeypatch):
    async def go():
        session = session_of()
        step = session.sim.step
        monkeypatch.setattr(session.sim, "step", lambda: (time.sleep(0.3), step()))
        async with serving(session) as server, page(server) as rude:
            await rude.until(lambda: rude.frame > 0)
            with contextlib.suppress(ConnectionClosed):
                for _ in range(100):
                    await rude.say("click", camera=CAMERA, at=[5, 5])
            await rude.until(lambda: rude.reason is not None)
            assert rude.reason == "too much asked for at once"
            before = session.frame
            async with page(server) as other:
                await other.until(lambda: session.frame > before)

    asyncio.run(go())


def test_moves_and_changes_that_wait_become_one(monkeypatch):
    """A slider that is dragged over a slow simulation does not queue up."""

    async def go():
        session = session_of()
        changes = []
        change = session._change
        monkeypatch.setattr(session, "_change", lambda these: (changes.append(dict(these)), change(these)))
        step = session.sim.step
        monkeypatch.setattr(session.sim, "step", lambda: (time.sleep(0.3), step()))
        async with serving(session) as server, page(server) as client:
            await client.until(lambda: client.frame > 0)
            for k in range(60):
                await client.say("change", changes={"iterations": 1 + k % 7} if k % 2 else {"substeps": 3 + k})
            await client.until(lambda: session.settings.substeps == 61 and session.settings.method.iterations == 4)
            assert len(changes) < 10
            assert client.reason is None

    asyncio.run(go())


def test_no_more_pages_than_there_is_room_for(monkeypatch):
    monkeypatch.setattr(module, "MOST_PAGES", 2)

    async def go():
        async with serving() as server, page(server), page(server):
            with pytest.raises(InvalidStatus) as refusal:
                async with page(server):
                    pass
            assert refusal.value.response.status_code == 503

    asyncio.run(go())


# Who may talk to it


def get(url, host=None):
    """Status, headers and body of what a URL gives."""
    request = urllib.request.Request(url, headers={"Host": host} if host else {})
    try:
        with urllib.request.urlopen(request, timeout=10) as response:
            return response.status, response.headers, response.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


def test_the_page_is_served_and_nothing_else():
    async def go():
        async with serving() as server:

            def fetch(path):
                return get(server.url + path)

            status, headers, body = await asyncio.to_thread(fetch, "")
            assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
            assert "default-src 'none'" in headers["Content-Security-Policy"]
            wanted = re.findall(rb'(?:src|href)="([^":]+)"', body)
            assert wanted == [b"style.css", b"view.js"]
            for path in (module.PAGE).iterdir():
                status, headers, body = await asyncio.to_thread(fetch, path.name)
                assert (status, body) == (200, path.read_bytes())
            for path in (
                "../server.py",
                "..%2fserver.py",
                "%2e%2e/server.py",
                "server.py",
                "page",
                "x?y",
                "/etc/passwd",
            ):
                status, _, _ = await asyncio.to_thread(fetch, path)
                assert status == 404

    asyncio.run(go())


def test_the_page_needs_no_network():
    """No file of the page names another place."""
    for path in module.PAGE.iterdir():
        assert not re.search(r"https?://|\bfrom ['\"](?!\./)|@import|\burl\(", path.read_text()), path


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("127.0.0.1:{port}", 200),
        ("localhost:{port}", 200),
        ("LOCALHOST:{port}", 200),
        ("[::1]:{port}", 200),
        ("evil.example:{port}", 403),
        ("evil.example", 403),
        ("127.0.0.1.evil.example:{port}", 403),
        ("192.168.1.5:{port}", 403),
        ("127.0.0.1", 403),
        ("127.0.0.1:1", 403),
        ("", 403),
        ("localhost:{port}:{port}", 403),
    ],
)
def test_foreign_hosts_are_refused(host, status):
    async def go():
        async with serving() as server:
            reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
            writer.write(f"GET / HTTP/1.1\r\nHost: {host.format(port=server.port)}\r\n\r\n".encode())
            answer = await reader.read()
            assert int(answer.split()[1]) == status
            writer.close()

    asyncio.run(go())


@pytest.mark.parametrize(
    "origin",
    [None, "null", "http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://localhost:{port}"],
)
def test_foreign_origins_are_refused(origin):
    async def go():
        async with serving() as server:
            given = origin and origin.format(port=server.port)
            with pytest.raises(InvalidStatus) as refusal:
                async with connect(f"ws://127.0.0.1:{server.port}/ws", origin=given):
                    pass
            assert refusal.value.response.status_code == 403
            assert not server._pages

    asyncio.run(go())


def test_other_machines_need_the_token():
    async def go():
        async with serving(host="0.0.0.0") as server, serving(host="0.0.0.0") as other:
            assert not server.loopback
            token = server.url.split("/")[3]
            assert len(token) >= 20
            assert token != other.url.split("/")[3]
            base = f"http://127.0.0.1:{server.port}/"
            for path, status in (
                (token + "/", 200),
                (f"{token}/view.js", 200),
                ("", 403),
                (token, 403),
                ("x" * 22 + "/", 403),
            ):
                assert (await asyncio.to_thread(get, base + path))[0] == status
            status, _, _ = await asyncio.to_thread(get, server.url, f"evil.example:{server.port}")
            assert status == 403, "a name is none of ours, token or not"
            status, _, _ = await asyncio.to_thread(get, server.url, f"{socket.gethostname()}:{server.port}")
            assert status == 200
            with pytest.raises(InvalidStatus):
                async with connect(f"ws://127.0.0.1:{server.port}/ws", origin=base.rstrip("/")):
                    pass
            async with page(server) as client:
                await client.until(lambda: client.frame > 0)

    asyncio.run(go())


def test_strangers_leave_no_trace_in_the_terminal(capsys, caplog):
    async def go():
        async with serving() as server:
            for text in (b"\x16\x03\x01 hello\r\n\r\n", b"POST / HTTP/1.1\r\nHost: x\r\n\r\n", b""):
                _, writer = await asyncio.open_connection("127.0.0.1", server.port)
                writer.write(text)
                await writer.drain()
                writer.close()
            await asyncio.sleep(0.1)

    with caplog.at_level(logging.DEBUG, logger="pbd_warp"):
        asyncio.run(go())
    assert capsys.readouterr().err == ""


def test_a_busy_port_gives_the_next():
    async def go():
        async with serving() as first:
            async with serving(port=first.port) as second:
                assert second.port > first.port
                assert (await asyncio.to_thread(get, second.url))[0] == 200
            with pytest.raises(pbd.InputError, match=r"cannot listen on 203\.0\.113\.9"):
                async with serving(host="203.0.113.9"):
                    pass
            with pytest.raises(pbd.InputError, match=r"cannot listen on no\.such\.host"):
                async with serving(host="no.such.host.invalid"):
                    pass

    asyncio.run(go())


# The command


def command(*args):
    return [sys.executable, "-u", "-c", "from pbd_warp.cli import main; main()", *map(str, args)]


def test_without_websockets_one_sentence_says_what_to_install(monkeypatch, capsys):
    from pbd_warp.cli import main

    monkeypatch.delitem(sys.modules, "pbd_warp.view.server")
    for name in [name for name in sys.modules if name.partition(".")[0] == "websockets"]:
        monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.setattr(sys, "argv", ["pbd-warp", "view", "worm", "--no-open"])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert capsys.readouterr().err == (
        "pbd-warp: the live view needs the package websockets: pip install 'pbd-warp[view]'\n"
    )


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_the_browser_is_opened_and_others_are_warned_of(host, monkeypatch, capfd):
    from pbd_warp.cli import main

    opened = []

    def open_and_end(url):
        opened.append((url, get(url)[0]))
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr("webbrowser.open", open_and_end)
    monkeypatch.setattr(sys, "argv", ["pbd-warp", "view", "worm", "--port", "0", "--host", host])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 0
    out, errors = capfd.readouterr()
    ((url, status),) = opened
    assert status == 200
    assert f"worm is live at {url} " in out
    assert ("warning: everybody who can reach 0.0.0.0" in errors) == (host == "0.0.0.0")


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["view", "roep"], "did you mean 'rope'"),
        (["view", "rope", "--port", "70000"], "--port must be in 0..65535"),
        (["view", "rope", "--substeps", "0"], "substeps must be at least 1"),
        (["view", "rope", "--record", "no/drags.json"], "no does not exist"),
        (["view", "rope", "--record", "."], "is a folder"),
        (["view", "collision", "--integrator", "midpoint"], "does not model contacts"),
        (["run", "rope", "--drags", "none.json"], "is no recording of drags"),
        (["run", "rope", "--drags", "none.json", "--substeps", "3"], "--drags brings the settings"),
        (["run", "rope", "--drags", "none.json", "--set", "links=3"], "no settings"),
    ],
)
def test_bad_usage(args, message, tmp_path, monkeypatch, capsys):
    from pbd_warp.cli import main

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["pbd-warp", *args])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_the_command_serves_says_where_and_keeps_the_recording_at_its_end(tmp_path):
    """From outside: a busy port, a page that drags, Ctrl-C, and `run --drags` does it again."""
    with socket.create_server(("127.0.0.1", 0)) as busy:
        port = busy.getsockname()[1]
        args = ["view", "worm", "--no-open", "--port", port, "--record", "drags.json", "--substeps", 8]
        process = subprocess.Popen(
            command(*args), cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert process.stdout.readline().startswith(f"port {port} is busy: took ")
        line = process.stdout.readline()
    url = re.search(r"worm is live at (http://127\.0\.0\.1:\d+/) ", line)[1]

    async def drag():
        address, origin = url.replace("http", "ws") + "ws", url.rstrip("/")
        async with connect(address, origin=origin) as connection:
            client = Client(connection)
            listening = asyncio.create_task(client.listen())
            await client.until(lambda: client.frame > 3)
            await client.say("click", camera=CAMERA, at=[400, 300])
            for k in range(20):
                await client.say("move", camera=CAMERA, at=[400 + 5 * k, 300])
                await asyncio.sleep(1 / 60)
            await client.until(lambda: client.frames[-1][4][0] > 0.3)
            listening.cancel()
            return {frame[1]: frame[4] for frame in client.frames}

    seen = asyncio.run(drag())
    process.send_signal(signal.SIGINT)
    out, errors = process.communicate(timeout=30)
    assert process.returncode == 0, errors
    assert "Traceback" not in errors
    assert re.search(r"\d+ frames of scene worm are recorded in drags.json", out)
    assert json.loads((tmp_path / "drags.json").read_text())["settings"]["substeps"] == 8

    done = subprocess.run(
        command("run", "worm", "--drags", "drags.json", "--out", "x.usda"), cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    points = UsdGeom.Points.Get(stage, "/World/Particles").GetPointsAttr()
    assert len(seen) > 20
    for frame, x in seen.items():
        np.testing.assert_array_equal(np.array(points.Get(frame)).ravel(), x)

    other = subprocess.run(
        command("run", "rope", "--drags", "drags.json"), cwd=tmp_path, capture_output=True, text=True
    )
    assert other.returncode == 2
    assert "the drags are of scene worm, not of rope" in other.stderr
