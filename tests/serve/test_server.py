"""`s2r serve`: who is let in, what the page refers to, what ends when."""

from __future__ import annotations

import os
import re
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from bench.support.processes import is_alive, wait_until
from s2rtui.cli import main
from tests.support.serving import StartServer

aiohttp = pytest.importorskip("aiohttp")


async def _get(url: str, **headers: str) -> tuple[int, str]:
    async with aiohttp.ClientSession() as session, session.get(url, headers=headers) as answer:
        return answer.status, await answer.text()


async def test_the_page_names_the_store_and_no_other_machine(serve: StartServer) -> None:
    server = serve()
    status, page = await _get(server.url)
    assert status == 200
    assert "<title>tiny.s2r</title>" in page
    assert re.findall(r"https?://[^\"' ]+", page) == []
    for file in re.findall(r'(?:href|src)="(static/[^"]+)"|url\("(static/[^"]+)"\)', page):
        status, content = await _get_bytes(server.root + "".join(file))
        assert status == 200
        assert len(content) > 1000


async def _get_bytes(url: str) -> tuple[int, bytes]:
    async with aiohttp.ClientSession() as session, session.get(url) as answer:
        return answer.status, await answer.read()


async def test_addresses_follow_the_one_that_was_asked(serve: StartServer) -> None:
    server = serve()
    _, page = await _get(server.url, Host="localhost:9999")
    assert "ws://localhost:9999/ws" in page
    assert str(server.port) not in page


@pytest.mark.parametrize(
    "headers",
    [{"Host": "evil.example"}, {"Origin": "http://evil.example"}, {"Origin": "null"}],
)
async def test_strangers_are_refused(serve: StartServer, headers: dict[str, str]) -> None:
    server = serve()
    for url in (server.url, server.socket):
        status, _ = await _get(url, **headers)
        assert status == 403
    assert server.applications == []


async def test_more_pages_than_users_are_refused(serve: StartServer) -> None:
    server = serve("--users", "1")
    async with aiohttp.ClientSession() as session, session.ws_connect(server.socket) as first:
        assert await _received(first, b"of 40")
        with pytest.raises(aiohttp.WSServerHandshakeError):
            await session.ws_connect(server.socket)


async def _received(socket: Any, wanted: bytes) -> bool:
    """Whether a page's terminal gets to hear something."""
    heard = b""
    while wanted not in heard:
        message = await socket.receive(60)
        if message.type is not aiohttp.WSMsgType.BINARY:
            return False
        heard += message.data
    return True


async def test_a_closed_page_ends_its_application(serve: StartServer) -> None:
    server = serve()
    async with aiohttp.ClientSession() as session:
        async with session.ws_connect(server.socket) as socket:
            assert await _received(socket, b"of 40")
            running = server.applications
            assert len(running) == 1
        assert wait_until(lambda: not is_alive(running[0]))


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel must tell of a parent's end")
async def test_a_killed_server_leaves_nothing_running(serve: StartServer) -> None:
    server = serve()
    async with aiohttp.ClientSession() as session, session.ws_connect(server.socket) as socket:
        assert await _received(socket, b"of 40")
        running = server.applications
        os.kill(server.process.pid, signal.SIGKILL)
        assert wait_until(lambda: not is_alive(running[0]))


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--host", "0.0.0.0"], "--public"),
        (["--host", "::"], "--public"),
        (["--host", "example.org"], "ssh -L"),
        (["--port", "0"], "1 to 65535"),
        (["--users", "0"], "--users"),
    ],
)
def test_wrong_requests(
    tiny_store: Path, capsys: pytest.CaptureFixture[str], options: list[str], told: str
) -> None:
    assert main(["serve", str(tiny_store), *options]) == 2
    err = capsys.readouterr().err
    assert told in err
    assert err.count("\n") == 1


def test_what_is_missing_is_named(
    tiny_store: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "s2rtui.web.server", raising=False)
    monkeypatch.setitem(sys.modules, "textual_serve", None)
    monkeypatch.setitem(sys.modules, "textual_serve.server", None)
    assert main(["serve", str(tiny_store)]) == 2
    assert "pip install 's2rtui[serve]'" in capsys.readouterr().err
    assert main(["serve", "/nowhere/x.s2r"]) == 2
    assert "no such folder" in capsys.readouterr().err


def test_a_taken_port_is_one_line(serve: StartServer, tiny_store: Path, capsys) -> None:
    server = serve()
    code = main(["serve", str(tiny_store), "--port", str(server.port)])
    assert code == 2
    assert f"{server.port}: cannot listen" in capsys.readouterr().err
