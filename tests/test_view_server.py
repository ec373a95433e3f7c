"""The live view on the network: what pages get, and that none holds up another."""

import asyncio
import json
import threading
import time

import aiohttp
import numpy as np
from pages import page, serving, session_of
from pxr import Usd, UsdGeom

import pbd_warp as pbd
from pbd_warp.grab.recording import Recording
from pbd_warp.step import loading
from pbd_warp.view.connection import IN_FLIGHT
from pbd_warp.view.server import ViewServer
from pbd_warp.view.session import Session


def test_a_page_gets_the_scene_then_frames_and_leads_a_particle():
    async def go():
        async with serving() as server, page(server) as client:
            await client.until(lambda: client.frame > 5)
            assert client.scene["scene"] == "worm"
            assert client.me == 1
            assert client.frames[-1][4].shape == (25, 3)
            assert client.status["settings"]["method"] == "gauss-seidel"
            assert client.status["pages"] == 1
            await client.select(0)
            await client.until(lambda: client.frames[-1][2:4] == (0, client.me))
            await client.say("move", position=[0.1, 0.05, 0.0])
            await client.until(lambda: client.frames[-1][4][0, 0] > 0.08)
            np.testing.assert_allclose(client.frames[-1][5], (0.1, 0.05, 0.0), rtol=1e-6)
            await client.say("release")
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
            await one.select(0)
            await two.until(lambda: two.frames[-1][2:4] == (0, one.me))
            await two.select(0)
            await two.until(lambda: two.said)
            assert two.said == [f"page {one.me} is dragging; wait until it lets go"]
            assert one.status["pages"] == 2
            await one.socket.close()
            await two.until(lambda: two.frames[-1][2:4] == (-1, 0))
            await two.select(0)
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
            await client.say("open", scene="point", parameters={}, changes={})
            await client.until(lambda: client.scene["scene"] == "point" and client.frames[-1][0] == 2)

    asyncio.run(go())


def test_a_simulation_that_cannot_keep_up_says_so(monkeypatch):
    async def go():
        session = session_of()
        async with serving(session) as server, page(server) as client:
            step = session.sim.step
            monkeypatch.setattr(session.sim, "step", lambda: (time.sleep(0.05), step()))
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
        session.paused = True
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


def test_the_address_is_there_before_the_simulation_and_pages_are_told_what_is_compiled(monkeypatch):
    async def go():
        session, go_on, threads = session_of(), threading.Event(), []
        begin = session.begin

        def slow():
            threads.append(threading.current_thread().name)
            for tell in loading.listeners:
                tell("distance, float32 (1 of 3)")
            assert go_on.wait(10)
            begin()

        monkeypatch.setattr(session, "begin", slow)
        server = ViewServer(session)
        await server.start()
        try:
            async with page(server) as client:
                await client.until(lambda: client.busy and client.busy["compiling"])
                assert client.busy == {"text": "Opening worm", "compiling": "distance, float32 (1 of 3)"}
                assert not server.begun.done()
                assert threads[0].startswith("simulation")
                go_on.set()
                await client.until(lambda: client.frame > 2)
                assert client.busy["text"] is None
                await client.say("open", scene="rope", parameters={}, changes={})
                await client.until(lambda: client.scene["scene"] == "rope")
                assert "Opening rope" in [told["text"] for told in client.waited]
                await client.until(lambda: client.busy["text"] is None)
                await client.say("change", changes={"method": "direct"})
                await client.until(lambda: client.status["settings"]["method"] == "direct")
                assert "Changing the settings" in [told["text"] for told in client.waited]
                assert any(told["compiling"] for told in client.waited[3:])
        finally:
            await server.stop()
        assert server._tell_loading not in loading.listeners

    asyncio.run(go())


def test_a_scene_and_its_frames_never_disagree():
    """Frames of a model come after its description, and none of another after that."""

    async def go():
        async with serving() as server, page(server) as client:
            order = []
            take = client.take

            async def note(data):
                await take(data)
                order.append(client.frames[-1][0] if isinstance(data, bytes) else json.loads(data))

            client.take = note
            for name in ("rope", "chain", "worm"):
                await client.say("open", scene=name, parameters={}, changes={})
                await client.until(lambda name=name: client.scene and client.scene["scene"] == name)
                await client.until(lambda: client.frames[-1][0] == client.scene["generation"])
            now = 1
            for each in order:
                if isinstance(each, dict) and each["type"] == "scene":
                    now = each["generation"]
                elif isinstance(each, int):
                    assert each == now

    asyncio.run(go())


def test_what_was_refused_comes_with_its_remedies():
    async def go():
        session = session_of("rope")
        async with serving(session) as server, page(server) as client:
            await client.until(lambda: client.frame > 0)
            await client.say("change", changes={"integrator": "bdf2"})
            await client.until(lambda: client.remedies)
            await client.say("change", changes=client.remedies[0]["changes"])
            await client.until(lambda: session.settings.integrator == "bdf2")
            assert session.settings.damping == 0.0

    asyncio.run(go())


def test_pages_that_are_open_when_the_server_ends_are_told():
    async def go():
        async with serving() as server, page(server) as client:
            await client.until(lambda: client.frame > 0)
            await server.stop()
            await client.until(lambda: client.socket.close_code is not None)
            assert (client.socket.close_code, client.reason) == (1001, "ended")

    asyncio.run(go())


def test_what_was_kept_and_what_was_done_can_be_saved(tmp_path):
    async def go():
        session = session_of("rope")
        async with serving(session) as server, page(server) as client:
            await client.until(lambda: client.frame > 3)
            await client.say("record", on=True)
            await client.until(lambda: client.status["kept"])
            await client.until(lambda: client.status["kept"] > 10)
            await client.say("record", on=False)
            await client.until(lambda: client.status["kept"] is None)
            async with aiohttp.ClientSession() as http:
                for name in ("clip.usdc", "clip.usda", "drags.json"):
                    async with http.get(f"{server.url}save/{name}") as answer:
                        assert answer.status == 200
                        disposition = answer.headers["Content-Disposition"]
                        (tmp_path / name).write_bytes(await answer.read())
                        assert "default-src 'none'" in answer.headers["Content-Security-Policy"]
                assert disposition == 'attachment; filename="rope.drags.json"'
                async with http.get(f"{server.url}save/rope.py") as answer:
                    assert answer.status == 404
            return session.clip.states

    states = asyncio.run(go())
    for name in ("clip.usdc", "clip.usda"):
        stage = Usd.Stage.Open(str(tmp_path / name))
        points = UsdGeom.Points.Get(stage, "/World/Particles").GetPointsAttr()
        assert points.GetTimeSamples() == list(range(len(states)))
        for frame, (x, *_) in enumerate(states):
            np.testing.assert_array_equal(np.array(points.Get(frame)), x)
    recording = Recording.load(tmp_path / "drags.json", "rope")
    assert recording.frames > 10
