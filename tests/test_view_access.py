"""Who may talk to the server, and what files it gives."""

import asyncio
import contextlib
import logging
import re
import socket
import urllib.error
import urllib.request

import aiohttp
import pytest
from pages import page, serving

import pbd_warp as pbd
from pbd_warp.view import access
from pbd_warp.view import server as module


def get(url, host=None):
    """Status, headers and body of what a URL gives."""
    request = urllib.request.Request(url, headers={"Host": host} if host else {})
    try:
        with urllib.request.urlopen(request, timeout=10) as response:
            return response.status, response.headers, response.read()
    except urllib.error.HTTPError as error:
        return error.code, error.headers, error.read()


async def status_of(server, host, path="/", method="GET"):
    """Of a request with that Host header, as it stands."""
    reader, writer = await asyncio.open_connection("127.0.0.1", server.port)
    writer.write(f"{method} {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n".encode())
    answer = await reader.read()
    writer.close()
    return int(answer.split()[1])


def test_the_page_is_served_and_nothing_else():
    async def go():
        async with serving() as server:

            def fetch(path):
                return get(server.url + path)

            status, headers, body = await asyncio.to_thread(fetch, "")
            assert (status, headers["Content-Type"]) == (200, "text/html; charset=utf-8")
            assert "default-src 'none'" in headers["Content-Security-Policy"]
            assert headers["X-Content-Type-Options"] == "nosniff"
            wanted = re.findall(rb'(?:src|href)="([^":]+)"', body)
            assert wanted == [b"style.css", b"view.js", b"save/clip.usdc", b"save/drags.json"]
            for path in module.FILES.values():
                status, headers, body = await asyncio.to_thread(fetch, path.name)
                assert (status, body) == (200, path.read_bytes())
            for path in (
                "../server.py",
                "..%2fserver.py",
                "%2e%2e/server.py",
                "server.py",
                "page",
                "x/y",
                "save/",
                "save/..%2fserver.py",
                "/etc/passwd",
            ):
                status, headers, _ = await asyncio.to_thread(fetch, path)
                assert status == 404, path
                assert "default-src 'none'" in headers["Content-Security-Policy"]
            host = f"127.0.0.1:{server.port}"
            assert await status_of(server, host, method="POST") == 405

    asyncio.run(go())


def test_the_page_needs_no_network():
    """No file of the page names another place, but for the name of a kind of XML."""
    for path in module.FILES.values():
        text = path.read_text().replace('"http://www.w3.org/2000/svg"', "")
        assert not re.search(r"https?://|\bfrom ['\"](?!\./)|@import|\burl\(", text), path


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
        ("127.0.0.1:{port}\r\nHost: 127.0.0.1:{port}", 403),
    ],
)
def test_foreign_hosts_are_refused(host, status):
    async def go():
        async with serving() as server:
            with contextlib.suppress(IndexError):  # aiohttp itself may refuse it without a word
                assert await status_of(server, host.format(port=server.port)) in (status, 400 if status != 200 else 200)

    asyncio.run(go())


@pytest.mark.parametrize(
    "origin",
    ["null", "http://evil.example", "https://127.0.0.1:{port}", "http://127.0.0.1:1", "http://localhost:{port}"],
)
def test_foreign_origins_are_refused(origin):
    async def go():
        async with serving() as server:
            given = origin.format(port=server.port)
            with pytest.raises(aiohttp.WSServerHandshakeError) as refusal:
                async with page(server, origin=given):
                    pass
            assert refusal.value.status == 403
            async with aiohttp.ClientSession() as session:
                with pytest.raises(aiohttp.WSServerHandshakeError) as refusal:
                    await session.ws_connect(server.url + "ws")  # no origin at all
            assert refusal.value.status == 403
            assert not server._pages

    asyncio.run(go())


def test_other_machines_need_the_token():
    async def go():
        async with serving(host="0.0.0.0") as server, serving(host="0.0.0.0") as other:
            assert not server.access.loopback
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
                ("save/drags.json", 403),
            ):
                assert (await asyncio.to_thread(get, base + path))[0] == status, path
            status, _, _ = await asyncio.to_thread(get, server.url, f"{socket.gethostname()}:{server.port}")
            assert status == 200
            with pytest.raises(aiohttp.WSServerHandshakeError):
                async with page(server, address=base):
                    pass
            async with page(server) as client:
                await client.until(lambda: client.frame > 0)

    asyncio.run(go())


def test_behind_a_tunnel_it_works_when_told_so():
    """The browser knows another name and port than the server; a tunnel that encrypts makes another scheme."""

    async def go():
        async with serving(also=["localhost:9000", "my.tunnel.example"]) as server:
            for host in ("localhost:9000", "my.tunnel.example", "My.Tunnel.Example"):
                assert await status_of(server, host) == 200
            for host in ("localhost:9001", "tunnel.example", "my.tunnel.example:9000"):
                assert await status_of(server, host) == 403
            for origin in ("http://localhost:9000", "https://my.tunnel.example"):
                async with page(server, origin=origin) as client:
                    await client.until(lambda client=client: client.frame > 0)
            with pytest.raises(aiohttp.WSServerHandshakeError):
                async with page(server, origin="https://other.example"):
                    pass

    asyncio.run(go())


def test_behind_a_tunnel_it_works_by_the_token():
    async def go():
        async with serving(token=True) as server:
            assert server.access.loopback
            path = "/" + server.url.split("/", 3)[3]
            assert len(path) > 20
            assert await status_of(server, "any.name.example", path) == 200
            assert await status_of(server, "any.name.example") == 403
            assert await status_of(server, f"127.0.0.1:{server.port}") == 403
            assert await status_of(server, f"127.0.0.1:{server.port}", path) == 200
            for origin, allowed in (("https://any.name.example", True), ("https://other.example", False)):
                assert server.access.is_own_origin([origin], "any.name.example") == allowed
            async with page(server) as client:
                await client.until(lambda: client.frame > 0)

    asyncio.run(go())


@pytest.mark.parametrize("name", ["http://x", "x/y", "", "user@x"])
def test_names_that_are_none_are_refused(name):
    with pytest.raises(pbd.InputError, match="a host is NAME or NAME:PORT"):
        access.Access("127.0.0.1", [name])


@pytest.mark.parametrize("host", ["0.0.0.0", "::"])
def test_addresses_that_others_can_use_are_named(host, monkeypatch):
    """Whatever this machine has: none of them loops back, and the one that it goes out by is the first."""
    for address in access.own_addresses(host):
        assert not re.match(r"127\.|::1$", address)
    monkeypatch.setattr(access, "own_addresses", lambda host: ["192.0.2.7", "fd00::7"])
    given = access.Access(host)
    given.port = 8417
    here = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}[host]
    assert given.urls() == [f"http://{name}:8417{given.path}" for name in (here, "192.0.2.7", "[fd00::7]")]
    assert access.Access("127.0.0.1").urls() == ["http://127.0.0.1:0/"]


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
