"""Pages that talk nonsense, or too much: they are told, or dropped, and nobody else notices."""

import asyncio
import contextlib
import time

import aiohttp
import pytest
from hypothesis import given
from pages import page, serving, session_of
from test_view_messages import odd_texts

from pbd_warp.view import server as module


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
                await (client.socket.send_bytes if isinstance(text, bytes) else client.socket.send_str)(text)
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
        ("x" * 20_000, 1, ""),
    ],
)
def test_a_page_that_floods_is_dropped_with_a_reason_and_the_others_go_on(text, count, reason):
    async def go():
        session = session_of()
        async with serving(session) as server, page(server) as other, page(server) as rude:
            await other.until(lambda: other.frame > 0 and rude.frame > 0)
            with contextlib.suppress(ConnectionError):
                for _ in range(count):
                    await rude.socket.send_str(text)
            await other.until(lambda: rude.reason is not None)
            assert reason in rude.reason
            assert rude.socket.close_code == (1008 if reason else 1009)
            seen = len(other.frames)
            await other.until(lambda: len(other.frames) > seen + 10)

    asyncio.run(go())


def test_a_page_that_asks_for_more_than_can_be_done_is_dropped(monkeypatch):
    async def go():
        session = session_of()
        async with serving(session) as server, page(server) as rude:
            step = session.sim.step
            monkeypatch.setattr(session.sim, "step", lambda: (time.sleep(0.3), step()))
            await rude.until(lambda: rude.frame > 0)
            with contextlib.suppress(ConnectionError):
                for _ in range(100):
                    await rude.select(3)
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
        async with serving(session) as server, page(server) as client:
            step = session.sim.step
            monkeypatch.setattr(session.sim, "step", lambda: (time.sleep(0.3), step()))
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
            with pytest.raises(aiohttp.WSServerHandshakeError) as refusal:
                async with page(server):
                    pass
            assert refusal.value.status == 503

    asyncio.run(go())
