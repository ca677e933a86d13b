"""`s2r serve` with hostile pages, requests and signals."""

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from bench.support.processes import (
    applications_below,
    is_alive,
    peak_bytes,
    program_environment,
    wait_until,
)
from tests.support.serving import ServerProcess, StartServer, servers

aiohttp = pytest.importorskip("aiohttp")
pytest.importorskip("textual_serve")

MAX_BYTES = 600 << 20
PROMPT_SECONDS = 10.0
HUGE_SIZE = 30_000


@pytest.fixture
def serve(tiny_store: Path, tmp_path: Path) -> Iterator[StartServer]:
    with servers(tiny_store, tmp_path / "data") as start:
        yield start


@pytest.fixture(scope="module")
def server(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    """A server that answers requests only."""
    with servers(tiny_store, tmp_path_factory.mktemp("serve")) as start:
        yield start()


def _request(
    server: ServerProcess, target: str, *headers: str, method: str = "GET"
) -> tuple[int, str, str]:
    """Status, head and body of the response to a raw request."""
    lines = "".join(f"{line}\r\n" for line in (f"{method} {target} HTTP/1.1", *headers))
    with socket.create_connection(("127.0.0.1", server.port), 10) as connection:
        connection.sendall(f"{lines}Connection: close\r\n\r\n".encode("latin-1"))
        answer = b""
        while chunk := connection.recv(1 << 16):
            answer += chunk
    head, _, body = answer.decode("latin-1").partition("\r\n\r\n")
    return int(head.split()[1]), head, body


def test_hosts_are_parsed_strictly(server):
    page = f"/?token={server.token}"
    for host in ("127.0.0.1", "localhost", "localhost:9999", "[::1]", f"127.0.0.1:{server.port}"):
        assert _request(server, page, f"Host: {host}")[0] == 200, host
    for host in ("evil.example", "127.0.0.1.evil.example", "localhost.", "[::2]"):
        assert _request(server, page, f"Host: {host}")[0] == 403, host
    for host in ("evil@127.0.0.1", "a b", "[::1", "[::1]x", "localhost:", "localhost:99999", ""):
        assert _request(server, page, f"Host: {host}")[0] == 400, host
    assert _request(server, page)[0] == 400
    assert _request(server, page, "Host: localhost", "Host: localhost")[0] == 400


def test_pages_of_other_origins_are_rejected(server):
    page = f"/?token={server.token}"
    for origin in ("null", "https://localhost", "http://localhost:1", "http://evil.example", "x"):
        for target in (page, f"/ws?token={server.token}"):
            status, _, _ = _request(server, target, "Host: localhost", f"Origin: {origin}")
            assert status == 403, origin
    assert _request(server, f"/ws?token={server.token}", "Host: evil.example")[0] == 403
    assert server.applications == []
    assert _request(server, page, "Host: localhost", "Origin: http://localhost")[0] == 200


def test_requests_without_the_token_are_rejected(server, serve):
    other = serve()
    assert len(server.token) >= 32
    assert server.token != other.token
    for target in ("/", "/?token=", f"/?token={other.token}", "/ws", "/ws/x", "/ws?token=%ff%00"):
        status, _, body = _request(server, target, "Host: localhost")
        assert status == 403, target
        assert body.count("\n") == 1
        assert "the complete URL that `s2r serve` printed" in body
    assert server.applications == []


def test_only_the_page_and_its_files_are_served(server):
    static_paths = ("", "/", "/js/", "/images/background.png", "/../server.py", "/%2e%2e/server.py")
    for target in (*(f"/static{rest}" for rest in static_paths), "/download/x", "/x"):
        assert _request(server, target, "Host: localhost")[0] == 404, target
    assert _request(server, "/", "Host: localhost", method="POST")[0] == 405
    page = _request(server, f"/?token={server.token}", "Host: localhost")
    assert page[0] == 200
    others = (_request(server, target, "Host: localhost") for target in ("/page.js", "/x"))
    for _, head, _ in (page, *others):
        assert "X-Content-Type-Options: nosniff" in head
        assert "Referrer-Policy: no-referrer" in head
        assert "Content-Security-Policy: default-src 'none'" in head
        assert "Cache-Control: no-store" in head
        assert "aiohttp" not in head


def test_oversized_requests_are_rejected(server):
    assert _request(server, "/" + "a" * 50_000, "Host: localhost")[0] == 400
    headers = [f"X-{number}: 1" for number in range(2000)]
    assert _request(server, "/", "Host: localhost", *headers)[0] == 400
    assert is_alive(server.process.pid)


async def _open_page(session: Any, server: ServerProcess, size: str = "?width=80&height=24") -> Any:
    """Open a page's socket and wait until its session draws."""
    page = await session.ws_connect(server.socket + size, max_msg_size=1 << 27)
    message = await page.receive(60)
    assert message.type is aiohttp.WSMsgType.BINARY
    return page


async def _eventually(condition: Callable[[], bool]) -> bool:
    """Whether a condition becomes true in time, without blocking the connections."""
    return await asyncio.to_thread(wait_until, condition, 2 * PROMPT_SECONDS)


async def _close_code(page: Any, timeout: float = 30) -> int | None:
    """The code with which a page is closed."""
    limit = time.monotonic() + timeout
    while time.monotonic() < limit:
        message = await page.receive(timeout)
        if message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED):
            return int(page.close_code)
    return None


async def _receives(page: Any, expected: str) -> bool:
    """Whether a text arrives."""
    async for message in page:
        if message.type is aiohttp.WSMsgType.TEXT and expected in message.data:
            return True
    return False


MALFORMED = [
    "{}", "[]", "[1]", '["stdin", 1]', '["stdin"]', '["resize", {"width": "a"}]', '["unknown"]',
    '["resize", {"width": true, "height": 1}]', '["resize", {"width": -1, "height": 1}]',
    '["resize", {"width": 1e400, "height": 1}]', '["ping", {"a": 1}]', "9" * 5000,
]  # fmt: skip


@pytest.mark.parametrize("text", MALFORMED, ids=lambda text: text[:30])
def test_malformed_messages_are_rejected(text):
    from s2rtui.web.protocol import MessageError, read_message

    with pytest.raises(MessageError):
        read_message(text)


async def test_a_malformed_message_ends_only_its_session(serve):
    server = serve()
    messages = ("no JSON", "[" * 60_000, b"binary")
    async with aiohttp.ClientSession() as session:
        unaffected = await _open_page(session, server)
        (running,) = server.applications
        for message in messages:
            page = await session.ws_connect(server.socket)
            send = page.send_bytes if isinstance(message, bytes) else page.send_str
            await send(message)
            assert await _close_code(page) == aiohttp.WSCloseCode.POLICY_VIOLATION, message
        page = await session.ws_connect(server.socket)
        await page.send_str(json.dumps(["stdin", "x" * (1 << 18)]))
        assert await _close_code(page) == aiohttp.WSCloseCode.MESSAGE_TOO_BIG
        await unaffected.send_str('["stdin", "\\ud800\\u0000"]')
        await unaffected.send_str('["ping", "still here"]')
        assert await _receives(unaffected, "still here")
        assert await _eventually(lambda: server.applications == [running])


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
async def test_a_huge_page_uses_little_memory(serve):
    server = serve()
    async with aiohttp.ClientSession() as session:
        first = await _open_page(session, server, f"?width={HUGE_SIZE}&height={HUGE_SIZE}")
        page = await _open_page(session, server)
        await page.send_str(json.dumps(["resize", {"width": HUGE_SIZE, "height": HUGE_SIZE}]))
        received = 0
        while received < 1 << 18:  # a complete large screen
            message = await page.receive(60)
            assert message.type is aiohttp.WSMsgType.BINARY
            received += len(message.data)
        assert len(server.applications) == 2
        for pid in (*server.applications, server.process.pid):
            assert 0 < peak_bytes(pid) < MAX_BYTES
        assert not first.closed
        server.process.terminate()
        start = time.monotonic()
        assert await asyncio.to_thread(server.process.wait, 30) == 0
        assert time.monotonic() - start < 2 * PROMPT_SECONDS


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
async def test_a_flood_of_keys_uses_little_memory_and_does_not_affect_others(serve):
    server = serve()
    async with aiohttp.ClientSession() as session:
        unaffected, flooding = await _open_page(session, server), await _open_page(session, server)
        keys = json.dumps(["stdin", "w&c" * 20_000])
        paste = json.dumps(["stdin", "\x1b[200~" + "x" * 60_000])
        for _ in range(300):
            await asyncio.wait_for(flooding.send_str(keys), 60)
            await asyncio.wait_for(flooding.send_str(paste), 60)
        await unaffected.send_str('["ping", "still here"]')
        assert await asyncio.wait_for(_receives(unaffected, "still here"), 60)
        for pid in (*server.applications, server.process.pid):
            assert 0 < peak_bytes(pid) < MAX_BYTES
        flooding._response.connection.transport.abort()
        assert await _eventually(lambda: len(server.applications) == 1)


async def test_simultaneous_pages_never_exceed_the_number_of_users(serve):
    server = serve("--users", "2")
    async with aiohttp.ClientSession() as session:
        attempts = [session.ws_connect(server.socket) for _ in range(12)]
        pages = await asyncio.gather(*attempts, return_exceptions=True)
        refused = [page for page in pages if isinstance(page, aiohttp.WSServerHandshakeError)]
        assert [error.status for error in refused] == [503] * 10


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel must tell of a parent's end")
@pytest.mark.parametrize(
    "number", [*(pytest.param(n, marks=pytest.mark.deep) for n in (signal.SIGTERM, signal.SIGINT)),
               signal.SIGKILL],
)  # fmt: skip
async def test_busy_sessions_end_with_the_server(serve, number):
    server = serve("--users", "3")
    async with aiohttp.ClientSession() as session:
        busy, stopped = await _open_page(session, server), await _open_page(session, server)
        await session.ws_connect(server.socket)  # still starting
        running = server.applications
        assert len(running) >= 2
        await busy.send_str(json.dumps(["resize", {"width": 1000, "height": 500}]))
        os.kill(running[0], signal.SIGSTOP)  # an unresponsive session
        start = time.monotonic()
        os.kill(server.process.pid, number)
        await asyncio.to_thread(server.process.wait, 30)
        assert await _eventually(lambda: not any(is_alive(pid) for pid in running))
        assert time.monotonic() - start < 2 * PROMPT_SECONDS
        assert not stopped.closed


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel must tell of a parent's end")
def test_a_session_does_not_start_after_its_server_has_ended(tiny_store):
    driver = "textual.drivers.web_driver:WebDriver"
    variables = {"TEXTUAL_DRIVER": driver, "S2R_SERVER": "1"}
    command = [sys.executable, "-P", "-m", "s2rtui", "tui", "--restricted", str(tiny_store)]
    session = subprocess.Popen(
        command, env=program_environment(**variables), stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        received, _ = session.communicate(timeout=30) if _ends(session) else (b"still running", b"")
        assert received == b""
    finally:
        session.kill()
        session.communicate()


def _ends(process: subprocess.Popen[bytes]) -> bool:
    return wait_until(lambda: process.poll() is not None, 300)


async def test_a_page_that_reads_nothing_ends_with_its_connection(serve):
    server = serve()
    path = re.sub(r"^http://[^/]*", "", server.socket)
    key = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA=="
    with socket.create_connection(("127.0.0.1", server.port)) as page:
        page.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        head = f"GET {path}?width=900&height=400 HTTP/1.1\r\nHost: localhost\r\n"
        upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
        page.sendall(f"{head}{upgrade}{key}\r\n\r\n".encode())
        assert b"101" in page.recv(64)
        assert wait_until(lambda: len(applications_below(server.process.pid)) == 1)
        running = server.applications
    assert wait_until(lambda: not is_alive(running[0]), 2 * PROMPT_SECONDS)
