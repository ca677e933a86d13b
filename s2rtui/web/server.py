"""Serves a store to browsers: one restricted application per page, nothing from elsewhere."""

from __future__ import annotations

import html
import logging
import shlex
import sys
from collections.abc import Awaitable, Callable
from importlib import resources
from pathlib import Path
from string import Template
from urllib.parse import urlsplit

from aiohttp import web
from textual_serve.server import Server

LOOPBACK = ("127.0.0.1", "localhost", "::1")

_FONT_SIZES = range(6, 49)
_HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; font-src 'self' data:; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self' $socket; "
    "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class StoreServer(Server):
    """Opens `store` for at most `users` pages at a time.

    Addresses in the page follow the one it was asked by, so that it works through a tunnel.
    """

    def __init__(self, store: Path, host: str, port: int, users: int, public: bool = False) -> None:
        words = [sys.executable, "-m", "s2rtui", "tui", "--restricted", str(store.absolute())]
        super().__init__(f"exec {shlex.join(words)}", host, port, title=store.name)
        self._users = users
        self._open = 0
        self._public = public
        self._page = Template(_file("page.html"))
        self._script = _file("page.js")

    def initialize_logging(self) -> None:
        logging.basicConfig(level="WARNING", format="s2r: %(message)s")

    async def on_startup(self, app: web.Application) -> None:
        print(f"{self.title}: {self.public_url} (ctrl+c ends it)", flush=True)

    async def _make_app(self) -> web.Application:
        app = await super()._make_app()
        app.router.add_get("/page.js", self._handle_script)
        app.middlewares.append(self._admit)
        return app

    async def _handle_script(self, request: web.Request) -> web.StreamResponse:
        return web.Response(text=self._script, content_type="text/javascript")

    @web.middleware
    async def _admit(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse pages of other sites, and names that only pretend to be this machine."""
        named = urlsplit(f"//{request.host}").hostname
        if not self._public and named not in LOOPBACK:
            raise web.HTTPForbidden(text=f"{request.host}: this server answers on loopback only")
        origin = request.headers.get("Origin")
        if origin is not None and urlsplit(origin).netloc != request.host:
            raise web.HTTPForbidden(text=f"{origin}: pages of other sites are not let in")
        return await handler(request)

    async def handle_index(self, request: web.Request) -> web.StreamResponse:
        """The page, with nothing in it that another machine would have to send."""
        asked = request.query.get("fontsize", "")
        size = int(asked) if asked.isdecimal() and int(asked) in _FONT_SIZES else 16
        scheme = "wss" if request.scheme == "https" else "ws"
        socket = f"{scheme}://{request.host}/ws"
        fields = {"title": self.title, "socket": socket, "font": str(size)}
        text = self._page.substitute({name: html.escape(value) for name, value in fields.items()})
        headers = {name: value.replace("$socket", socket) for name, value in _HEADERS.items()}
        return web.Response(text=text, content_type="text/html", headers=headers)

    async def handle_websocket(self, request: web.Request) -> web.WebSocketResponse:
        if self._open >= self._users:
            raise web.HTTPServiceUnavailable(text=f"all {self._users} sessions are taken")
        self._open += 1
        try:
            return await super().handle_websocket(request)
        finally:
            self._open -= 1


def _file(name: str) -> str:
    return resources.files("s2rtui.web").joinpath(name).read_text(encoding="utf-8")
