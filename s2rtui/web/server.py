"""HTTP server for a store: one restricted application per page, no external resources."""

from __future__ import annotations

import asyncio
import html
import logging
import signal
from collections.abc import Awaitable, Callable, Coroutine
from contextlib import suppress
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
from s2rtui.web.protocol import MAX_MESSAGE_BYTES, MessageError, Ping, initial_size, read_message
from s2rtui.web.request_check import LOOPBACK, RequestCheck, url_host

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
_HEARTBEAT_SECONDS = 15.0
_REQUEST_TIMEOUT = 10.0
"""Time in seconds after which a connection without a complete request is dropped."""
_MAX_CONNECTIONS = 64
"""Concurrent connections besides the connections of the sessions."""
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class StoreServer:
    """Server of pages in a browser, each with a separate session on the store.

    Addresses in the page derive from the address of the request, so that tunnels work.
    """

    def __init__(self, store: Path, host: str, port: int, users: int, public: bool) -> None:
        """`users` limits the sessions; `public` accepts any host name of this machine."""
        self._store, self._host, self._port, self._users = store, host, port, users
        self._title = printable(store.name or str(store.absolute()))
        hosts = None if public else (*LOOPBACK, url_host(host).lower())
        self._request_check = RequestCheck(hosts)
        self._sessions: set[asyncio.Task[None]] = set()
        self._active_transports: WeakSet[asyncio.BaseTransport] = WeakSet()
        self._page = Template(_page_file("page.html"))
        self._script = _page_file("page.js")

    @property
    def address(self) -> str:
        """The address to open, with the token."""
        return f"http://{url_host(self._host)}:{self._port}/?token={self._request_check.token}"

    def serve(self) -> None:
        """Serve until SIGINT or SIGTERM. Raises OSError if it cannot listen on the port."""
        logging.basicConfig(level="WARNING", format="s2r: %(message)s")
        logging.getLogger("aiohttp.server").addFilter(_is_server_fault)
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        loop, stop = asyncio.get_running_loop(), asyncio.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        runner = web.AppRunner(
            self._application(), handle_signals=False, access_log=None, keepalive_timeout=30,
            lingering_time=0, shutdown_timeout=0.5, handler_cancellation=True,
        )  # fmt: skip
        await runner.setup()
        try:
            listening = await loop.create_server(
                lambda: self._connection(runner), self._host, self._port
            )
            print(f"{self._title}: {self.address} (press ctrl+c to stop)", flush=True)
            await stop.wait()
            listening.close()
        finally:
            await self._end_sessions()
            await runner.cleanup()

    def _connection(self, runner: web.AppRunner) -> asyncio.Protocol:
        """Return the protocol of a new connection; it is dropped if no request arrives in time."""
        assert runner.server is not None
        if len(runner.server.connections) >= _MAX_CONNECTIONS + self._users:
            return _RefusedConnection()
        protocol = runner.server()
        asyncio.get_running_loop().call_later(_REQUEST_TIMEOUT, self._drop_inactive, protocol)
        return protocol

    def _drop_inactive(self, protocol: web.RequestHandler) -> None:
        transport = protocol.transport
        if transport is not None and transport not in self._active_transports:
            transport.abort()

    async def _end_sessions(self) -> None:
        for session in self._sessions:
            session.cancel()
        await asyncio.gather(*self._sessions, return_exceptions=True)

    def _application(self) -> web.Application:
        application = web.Application(middlewares=[self._check_request], client_max_size=1)
        application.router.add_get("/", self._index)
        application.router.add_get("/page.js", self._page_script)
        application.router.add_get("/ws", self._socket)
        application.router.add_get("/ws/{token}", self._socket)
        application.router.add_get("/static/{name:.+}", self._library_file)
        application.on_response_prepare.append(_add_headers)
        return application

    @web.middleware
    async def _check_request(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if request.transport is not None:
            self._active_transports.add(request.transport)
        self._request_check.check_address(request)
        return await handler(request)

    async def _index(self, request: web.Request) -> web.StreamResponse:
        """Return the page; it refers to no other server."""
        self._request_check.check_token(request.query.get("token", ""))
        font_size = request.query.get("fontsize", "")
        size = int(font_size) if font_size in map(str, _FONT_SIZES) else 16
        scheme = "wss" if request.scheme == "https" else "ws"
        socket = f"{scheme}://{request.host}"
        path = f"{socket}/ws/{self._request_check.token}"
        fields = {"title": self._title, "socket": path, "font": str(size)}
        text = self._page.substitute({name: html.escape(value) for name, value in fields.items()})
        policy = {"Content-Security-Policy": _PAGE_POLICY.replace("$socket", socket)}
        return web.Response(text=text, content_type="text/html", headers=policy)

    async def _page_script(self, request: web.Request) -> web.StreamResponse:
        return web.Response(text=self._script, content_type="text/javascript")

    async def _library_file(self, request: web.Request) -> web.StreamResponse:
        """Return one of the files of textual-serve that the page needs."""
        name = request.match_info["name"]
        if name not in _LIBRARY_FILES:
            raise web.HTTPNotFound(text="no such file\n")
        return web.FileResponse(_LIBRARY / name)

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        self._request_check.check_token(
            request.match_info.get("token") or request.query.get("token", "")
        )
        if len(self._sessions) >= self._users:
            text = f"all {self._users} sessions are in use; try again later\n"
            raise web.HTTPServiceUnavailable(text=text)
        socket = web.WebSocketResponse(
            heartbeat=_HEARTBEAT_SECONDS, max_msg_size=MAX_MESSAGE_BYTES, compress=False,
            timeout=0.5,
        )  # fmt: skip
        if not socket.can_prepare(request):
            raise web.HTTPBadRequest(text="not a WebSocket\n")
        # A separate task ends its session even if the request is cancelled.
        session = asyncio.create_task(self._connect_session(request, socket))
        self._sessions.add(session)
        session.add_done_callback(self._sessions.discard)
        try:
            await asyncio.shield(session)
        finally:
            session.cancel()
        return socket

    async def _connect_session(self, request: web.Request, socket: web.WebSocketResponse) -> None:
        """Connect a page with a new session until one of them ends; then end both."""
        await socket.prepare(request)
        size = initial_size(request.query.get("width", ""), request.query.get("height", ""))
        session = await PageSession.start(self._store, size)
        tasks = [
            asyncio.create_task(session.forward(socket.send_bytes)),
            asyncio.create_task(_listen(socket, session)),
        ]
        code = WSCloseCode.OK
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            if tasks[1].done() and isinstance(tasks[1].exception(), MessageError):
                code = WSCloseCode.POLICY_VIOLATION
        finally:
            await _run_to_completion(_end(tasks, session))
        with suppress(ConnectionError, RuntimeError):
            await socket.close(code=code)


def _is_server_fault(record: logging.LogRecord) -> bool:
    """Return False for log records of malformed requests, which are answered with status 400."""
    return not (record.exc_info and isinstance(record.exc_info[1], HttpProcessingError))


class _RefusedConnection(asyncio.Protocol):
    """Protocol that closes a connection beyond the limit."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        transport.abort()


async def _listen(socket: web.WebSocketResponse, session: PageSession) -> None:
    """Forward messages of the page until it closes. Raises MessageError."""
    async for message in socket:
        if message.type is not WSMsgType.TEXT:
            raise MessageError("not text")
        content = read_message(message.data)
        if isinstance(content, Ping):
            await socket.send_json(["pong", content.text])
        else:
            session.write(content)
        await asyncio.sleep(0)  # lets other sessions run while one page floods


async def _end(tasks: list[asyncio.Task[None]], session: PageSession) -> None:
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    await session.end()


async def _run_to_completion(work: Coroutine[Any, Any, None]) -> None:
    """Wait for a short coroutine that must not be interrupted when the caller is cancelled."""
    task = asyncio.create_task(work)
    while not task.done():
        with suppress(asyncio.CancelledError):
            await asyncio.shield(task)


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    for name, value in _HEADERS.items():
        if name == "Server" or name not in response.headers:
            response.headers[name] = value


def _page_file(name: str) -> str:
    return resources.files("s2rtui.web").joinpath(name).read_text(encoding="utf-8")
