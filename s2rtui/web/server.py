"""Serves a store to browsers: one restricted application per page, nothing from elsewhere."""

from __future__ import annotations

import asyncio
import html
import logging
import signal
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any
from weakref import WeakSet

import textual_serve
from aiohttp import WSCloseCode, WSMsgType, web
from aiohttp.http_exceptions import HttpProcessingError

from s2rstore.security.printable_text import printable
from s2rtui.web.page_session import PageSession
from s2rtui.web.protocol import LONGEST_MESSAGE, MessageError, Ping, first_size, read_message
from s2rtui.web.request_check import LOOPBACK, RequestCheck, in_address

_FONT_SIZES = range(6, 49)
_LIBRARY = Path(textual_serve.__file__).parent / "static"
_LIBRARY_FILES = ("css/xterm.css", "js/textual.js", "fonts/RobotoMono-VariableFont_wght.ttf")
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "Server": "s2r",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}
_PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; font-src 'self' data:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self' $socket; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
)
_HEARTBEAT = 15.0
_REQUEST_PATIENCE = 10.0
"""Seconds until a connection without a complete request is dropped."""
_CONNECTIONS = 64
"""Connections at a time, beside those of the sessions."""
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


@dataclass(frozen=True, slots=True)
class Served:
    """What a server is asked to do: a store, where to listen, how many pages at a time.

    `public` lets in requests by any name of this machine.
    """

    store: Path
    host: str
    port: int
    users: int
    public: bool = False


class StoreServer:
    """Opens a store for pages in a browser, each with a session of its own.

    Addresses in the page follow the one it was asked by, so that it works through a tunnel.
    """

    def __init__(self, served: Served) -> None:
        self._served = served
        self._title = printable(served.store.name or str(served.store.absolute()))
        hosts = None if served.public else (*LOOPBACK, in_address(served.host).lower())
        self._admission = RequestCheck(hosts)
        self._sessions: set[asyncio.Task[None]] = set()
        self._heard: WeakSet[asyncio.BaseTransport] = WeakSet()
        self._page = Template(_file("page.html"))
        self._script = _file("page.js")

    @property
    def address(self) -> str:
        """What to open, with the token."""
        host = in_address(self._served.host)
        return f"http://{host}:{self._served.port}/?token={self._admission.token}"

    def serve(self) -> None:
        """Serve until SIGINT or SIGTERM. Raises OSError where the port cannot be listened on."""
        logging.basicConfig(level="WARNING", format="s2r: %(message)s")
        logging.getLogger("aiohttp.server").addFilter(_is_own_fault)
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        loop, told = asyncio.get_running_loop(), asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, told.set)
        runner = web.AppRunner(
            self._application(), handle_signals=False, access_log=None, keepalive_timeout=30,
            lingering_time=0, shutdown_timeout=0.5, handler_cancellation=True,
        )  # fmt: skip
        await runner.setup()
        try:
            listening = await loop.create_server(
                lambda: self._connection(runner), self._served.host, self._served.port
            )
            print(f"{self._title}: {self.address} (ctrl+c ends it)", flush=True)
            await told.wait()
            listening.close()
        finally:
            await self._end_sessions()
            await runner.cleanup()

    def _connection(self, runner: web.AppRunner) -> asyncio.Protocol:
        """A protocol for a new connection; it is dropped where it sends no request in time."""
        assert runner.server is not None
        if len(runner.server.connections) >= _CONNECTIONS + self._served.users:
            return _Refusal()
        protocol = runner.server()
        loop = asyncio.get_running_loop()
        loop.call_later(_REQUEST_PATIENCE, self._drop_silent, protocol)
        return protocol

    def _drop_silent(self, protocol: web.RequestHandler) -> None:
        transport = protocol.transport
        if transport is not None and transport not in self._heard:
            transport.abort()

    async def _end_sessions(self) -> None:
        for session in self._sessions:
            session.cancel()
        await asyncio.gather(*self._sessions, return_exceptions=True)

    def _application(self) -> web.Application:
        application = web.Application(middlewares=[self._admit], client_max_size=1)
        application.router.add_get("/", self._index)
        application.router.add_get("/page.js", self._page_script)
        application.router.add_get("/ws", self._socket)
        application.router.add_get("/ws/{token}", self._socket)
        application.router.add_get("/static/{name:.+}", self._library_file)
        application.on_response_prepare.append(_add_headers)
        return application

    @web.middleware
    async def _admit(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if request.transport is not None:
            self._heard.add(request.transport)
        self._admission.check_address(request)
        return await handler(request)

    async def _index(self, request: web.Request) -> web.StreamResponse:
        """The page, with nothing in it that another machine would have to send."""
        self._admission.check_token(request.query.get("token", ""))
        asked = request.query.get("fontsize", "")
        size = int(asked) if asked in map(str, _FONT_SIZES) else 16
        scheme = "wss" if request.scheme == "https" else "ws"
        socket = f"{scheme}://{request.host}"
        path = f"{socket}/ws/{self._admission.token}"
        fields = {"title": self._title, "socket": path, "font": str(size)}
        text = self._page.substitute({name: html.escape(value) for name, value in fields.items()})
        policy = {"Content-Security-Policy": _PAGE_POLICY.replace("$socket", socket)}
        return web.Response(text=text, content_type="text/html", headers=policy)

    async def _page_script(self, request: web.Request) -> web.StreamResponse:
        return web.Response(text=self._script, content_type="text/javascript")

    async def _library_file(self, request: web.Request) -> web.StreamResponse:
        """A file of the terminal in the page; the folder has others, which are not served."""
        name = request.match_info["name"]
        if name not in _LIBRARY_FILES:
            raise web.HTTPNotFound(text="no such file\n")
        return web.FileResponse(_LIBRARY / name)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        given = request.match_info.get("token") or request.query.get("token", "")
        self._admission.check_token(given)
        if len(self._sessions) >= self._served.users:
            told = f"all {self._served.users} sessions are taken\n"
            raise web.HTTPServiceUnavailable(text=told)
        socket = web.WebSocketResponse(
            heartbeat=_HEARTBEAT, max_msg_size=LONGEST_MESSAGE, compress=False, timeout=0.5
        )
        if not socket.can_prepare(request):
            raise web.HTTPBadRequest(text="not a WebSocket\n")
        # A task of its own: it ends its session also where the request is cancelled.
        session = asyncio.create_task(self._hold(request, socket))
        self._sessions.add(session)
        session.add_done_callback(self._sessions.discard)
        try:
            await asyncio.shield(session)
        finally:
            session.cancel()
        return socket

    async def _hold(self, request: web.Request, socket: web.WebSocketResponse) -> None:
        """Join a page and a session until one of them ends; then end both."""
        await socket.prepare(request)
        size = first_size(request.query.get("width", ""), request.query.get("height", ""))
        session = await PageSession.start(self._served.store, size)
        ways = [
            asyncio.create_task(session.forward(socket.send_bytes)),
            asyncio.create_task(_listen(socket, session)),
        ]
        code = WSCloseCode.OK
        try:
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
            if ways[1].done() and isinstance(ways[1].exception(), MessageError):
                code = WSCloseCode.POLICY_VIOLATION
        finally:
            await _completed(_end(ways, session))
        with suppress(ConnectionError, RuntimeError):
            await socket.close(code=code)


def _is_own_fault(record: logging.LogRecord) -> bool:
    """Whether a record is about more than a malformed request, which is answered with 400."""
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))


class _Refusal(asyncio.Protocol):
    """A connection too many."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


async def _listen(socket: web.WebSocketResponse, session: PageSession) -> None:
    """Pass on what the page sends until it closes. Raises MessageError."""
    async for message in socket:
        if message.type is not WSMsgType.TEXT:
            raise MessageError("not text")
        meant = read_message(message.data)
        if isinstance(meant, Ping):
            await socket.send_json(["pong", meant.text])
        else:
            session.write(meant)
        await asyncio.sleep(0)  # a page that floods does not keep the others waiting


async def _end(ways: list[asyncio.Task[None]], session: PageSession) -> None:
    for way in ways:
        way.cancel()
    await asyncio.gather(*ways, return_exceptions=True)
    await session.end()


async def _completed(work: Coroutine[Any, Any, None]) -> None:
    """Wait for short work that cancelling the caller must not interrupt."""
    task = asyncio.create_task(work)
    while not task.done():
        with suppress(asyncio.CancelledError):
            await asyncio.shield(task)


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    for name, value in _HEADERS.items():
        if name == "Server":
            response.headers[name] = value
        else:
            response.headers.setdefault(name, value)


def _file(name: str) -> str:
    return resources.files("s2rtui.web").joinpath(name).read_text(encoding="utf-8")
