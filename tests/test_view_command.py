"""`pbd-warp view` from outside, and `run --drags` after it."""

import asyncio
import errno
import json
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import types

import aiohttp
import numpy as np
import pytest
from pages import Client
from test_view_access import get

from pbd_warp.view.shortage import Shortage


def command(*args):
    return [sys.executable, "-u", "-c", "from pbd_warp.cli import main; main()", *map(str, args)]


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
        (["view", "rope", "--allow-host", "http://x"], "a host is NAME or NAME:PORT"),
        (["view", "rope", "--substeps", "0"], "substeps must be at least 1"),
        (["view", "rope", "--record", "no/drags.json"], "no does not exist"),
        (["view", "rope", "--record", "."], "is a folder"),
        (["view", "collision", "--integrator", "midpoint"], "does not model contacts"),
        (["run", "rope", "--drags", "none.json"], "is no recording of drags"),
        (["run", "rope", "--drags", "none.json", "--substeps", "3"], "--drags brings the settings"),
        (["run", "rope", "--drags", "none.json", "--set", "links=3"], "no parameters"),
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


@pytest.mark.skipif(not hasattr(resource, "prlimit"), reason="limits of Linux")
@pytest.mark.parametrize("stopped", ["later", "amid"])
def test_without_file_descriptors_the_log_stays_small_and_pages_come_back(tmp_path, stopped):
    """Connections beyond the limit for some seconds: one line, and the page that is open goes on; when they are gone,
    pages are let in as before. Ctrl-C then, or while asyncio waits to listen again, says no more."""
    process = subprocess.Popen(
        command("view", "worm", "--no-open"), cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    line = process.stdout.readline()
    while "is live at" not in line:
        line = process.stdout.readline()
    url, port = re.search(r"(http://127\.0\.0\.1:(\d+)/)", line).groups()

    async def crowd():
        async with aiohttp.ClientSession() as http:
            async with http.ws_connect(url + "ws", headers={"Origin": url.rstrip("/")}) as page:
                client = Client(page)
                listening = asyncio.create_task(client.listen())
                await client.until(lambda: client.frame > 3, seconds=60.0)
                highest = max(int(name) for name in os.listdir(f"/proc/{process.pid}/fd"))
                _, most = resource.prlimit(process.pid, resource.RLIMIT_NOFILE)
                resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (highest + 8, most))
                crowd = [socket.create_connection(("127.0.0.1", int(port))) for _ in range(40)]
                await asyncio.sleep(3.5)  # asyncio tries again every second
                frame = client.frame
                await client.until(lambda: client.frame > frame + 10)
                if stopped == "amid":
                    process.send_signal(signal.SIGINT)
                    listening.cancel()
                    await asyncio.sleep(2.0)
                    return
                for connection in crowd:
                    connection.close()
                await asyncio.sleep(1.0)
                listening.cancel()
            async with http.get(url) as answer:
                assert b"<title>pbd-warp</title>" in await answer.read()

    asyncio.run(crowd())
    if stopped == "later":
        process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    said = [text for text in errors.splitlines() if "a page could not be let in: Too many open files" in text]
    assert len(said) == 1, errors
    assert len(errors.splitlines()) < 5, errors


def test_a_shortage_is_told_once_a_minute_and_everything_else_as_ever(capsys):
    now = iter([0.0, 0.0, 1.0, 59.0, 60.5, 61.0])
    handle = Shortage(lambda: next(now))
    others = []
    loop = types.SimpleNamespace(default_exception_handler=others.append)
    short = {"exception": OSError(errno.EMFILE, "Too many open files")}
    for _ in range(5):
        handle(loop, short)
    assert capsys.readouterr().err.count("could not be let in: Too many open files") == 2
    other = {"exception": OSError(errno.EPIPE, "gone")}
    handle(loop, other)
    assert others == [other]


def test_a_closed_socket_is_told_but_right_after_a_shortage(capsys):
    now = iter([0.0, 0.0, 1.0, 1.0, 100.0])
    handle = Shortage(lambda: next(now))
    others = []
    loop = types.SimpleNamespace(default_exception_handler=others.append)
    closed = {"exception": ValueError("Invalid file descriptor: -1")}
    handle(loop, closed)
    handle(loop, {"exception": OSError(errno.EMFILE, "Too many open files")})
    handle(loop, closed)
    handle(loop, closed)
    assert others == [closed, closed]


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
        origin = url.rstrip("/")
        async with aiohttp.ClientSession() as http, http.ws_connect(url + "ws", headers={"Origin": origin}) as socket:
            client = Client(socket)
            listening = asyncio.create_task(client.listen())
            await client.until(lambda: client.frame > 3, seconds=60.0)
            await client.select(0)
            for k in range(20):
                await client.say("move", position=[0.02 * k, 0.0, 0.0])
                await asyncio.sleep(1 / 60)
            await client.until(lambda: client.frames[-1][4][0, 0] > 0.3)
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
        np.testing.assert_array_equal(np.array(points.Get(frame)), x)

    other = subprocess.run(
        command("run", "rope", "--drags", "drags.json"), cwd=tmp_path, capture_output=True, text=True
    )
    assert other.returncode == 2
    assert "the drags are of scene worm, not of rope" in other.stderr
