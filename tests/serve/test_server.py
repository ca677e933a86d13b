"""`s2r serve`: access control, page content, session lifetime, and a page in a browser.

The browser is a headless Chromium with access only to the loopback network.
"""

import asyncio
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest

from bench.support.processes import is_alive, wait_until
from s2rtui.cli import main
from tests.support.serving import StartServer, servers

pytest.importorskip("aiohttp")

import aiohttp

from tests.support import chromium


@pytest.fixture
def serve(tiny_store: Path, tmp_path: Path) -> Iterator[StartServer]:
    """A function that starts servers of the tiny store; they end with the test."""
    pytest.importorskip("textual_serve")
    with servers(tiny_store, tmp_path / "data") as start:
        yield start


async def _get(url: str, **headers: str) -> tuple[int, bytes]:
    async with aiohttp.ClientSession() as session, session.get(url, headers=headers) as response:
        return response.status, await response.read()


async def test_the_page_names_the_store_and_no_other_host(serve):
    server = serve()
    status, content = await _get(server.url)
    page = content.decode()
    assert status == 200
    assert "<title>tiny.s2r</title>" in page
    assert re.findall(r"https?://[^\"' ]+", page) == []
    for file in re.findall(r'(?:href|src)="(static/[^"]+)"|url\("(static/[^"]+)"\)', page):
        status, content = await _get(server.root + "".join(file))
        assert status == 200
        assert len(content) > 1000


async def test_addresses_follow_the_requested_host(serve):
    server = serve()
    _, page = await _get(server.url, Host="localhost:9999")
    assert b"ws://localhost:9999/ws" in page
    assert str(server.port).encode() not in page


async def _receives(socket: Any, expected: bytes) -> bool:
    """Whether the terminal of a page receives a text."""
    received = b""
    while expected not in received:
        message = await socket.receive(60)
        if message.type is not aiohttp.WSMsgType.BINARY:
            return False
        received += message.data
    return True


async def test_a_closed_page_ends_its_application(serve):
    server = serve()
    async with aiohttp.ClientSession() as session:
        async with session.ws_connect(server.socket) as socket:
            assert await _receives(socket, b"of 40")
            running = server.applications
            assert len(running) == 1
        assert wait_until(lambda: not is_alive(running[0]))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--host", "0.0.0.0"], "--public"), (["--host", "::"], "--public"),
        (["--host", "example.org"], "ssh -L"), (["--port", "0"], "1 to 65535"),
        (["--users", "0"], "--users"),
    ],
)  # fmt: skip
def test_invalid_options_are_rejected(tiny_store, s2r, options, expected):
    s2r("serve", tiny_store, *options).assert_refused(expected)


def test_missing_packages_and_stores_are_named(tiny_store, s2r, monkeypatch):
    monkeypatch.delitem(sys.modules, "s2rtui.web.server", raising=False)
    monkeypatch.setitem(sys.modules, "textual_serve", None)
    monkeypatch.setitem(sys.modules, "textual_serve.server", None)
    s2r("serve", tiny_store).assert_refused("pip install 's2rtui[serve]'")
    s2r("serve", "/nowhere/x.s2r").assert_refused("no such folder")


def test_a_port_in_use_is_reported_in_one_line(serve, tiny_store, capsys):
    server = serve()
    code = main(["serve", str(tiny_store), "--port", str(server.port)])
    assert code == 2
    assert f"{server.port}: cannot listen" in capsys.readouterr().err


async def _is_redrawn(page: chromium.Page, before: bytes) -> bool:
    """Whether the page changes soon; it is drawn in the next frame."""
    for _ in range(100):
        if await page.screenshot() != before:
            return True
        await asyncio.sleep(0.05)
    return False


async def _is_closed(page: chromium.Page) -> bool:
    """Whether the page soon shows that its session has ended."""
    for _ in range(100):
        if await page.evaluate("document.body.classList.contains('-closed')") is True:
            return True
        await asyncio.sleep(0.05)
    return False


async def test_keys_in_the_page_change_the_selection(serve, tmp_path):
    missing = chromium.missing_program()
    if missing:
        pytest.skip(f"{missing} is not installed")
    server = serve()
    async with chromium.browser(tmp_path / "profile") as page:
        await page.open(server.url)
        first = await page.wait_for("of 40")
        assert first.splitlines()[0].strip().startswith("tiny.s2r")
        assert await page.evaluate("document.title") == "tiny.s2r"
        await page.press("c")
        await page.wait_for("│ 40 of 40 │")
        before = await page.screenshot()
        await page.press("w")
        text = await page.wait_for("│ 6 of 40 │")
        assert "worst15" in text
        assert await _is_redrawn(page, before)
        hosts = {urlsplit(url).netloc for url in page.requests if not url.startswith("data:")}
        assert hosts == {f"127.0.0.1:{server.port}"}
        assert [url for url in page.requests if url.startswith("ws://")]
        assert page.failures == []
        assert await page.evaluate("document.fonts.check('16px Roboto Mono')") is True
        await page.press("q")
        assert wait_until(lambda: server.applications == [])
        assert await _is_closed(page)
