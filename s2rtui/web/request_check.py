"""Admission of requests: a known host name, a page of this server as origin, and the token."""

from __future__ import annotations

import hmac
import re
import secrets
from dataclasses import dataclass, field

from aiohttp import web

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")

_HOST = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9][a-z0-9._-]{0,252})(?::([0-9]{1,5}))?", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class RequestCheck:
    """Checks of a request; `hosts` are the allowed host names, None for any.

    Any port is allowed, so that tunnels work. The token is random for each start of a server.
    """

    hosts: tuple[str, ...] | None = LOOPBACK
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)

    def check_address(self, request: web.Request) -> None:
        """Refuse other hosts and other origins (403), and malformed hosts (400)."""
        hosts = request.headers.getall("Host", [])
        host = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
        if host is None or (host[2] is not None and not 1 <= int(host[2]) <= 65535):
            raise web.HTTPBadRequest(text="malformed Host header\n")
        if self.hosts is not None and host[1].lower() not in self.hosts:
            raise web.HTTPForbidden(text="this server accepts loopback host names only\n")
        for origin in request.headers.getall("Origin", []):
            if origin.lower() != f"{request.scheme}://{hosts[0].lower()}":
                raise web.HTTPForbidden(text="requests from pages of other sites are refused\n")

    def check_token(self, token: str) -> None:
        """Raise HTTPForbidden unless the token is correct."""
        if not hmac.compare_digest(token.encode("utf-8", "replace"), self.token.encode()):
            raise web.HTTPForbidden(
                text="token missing or wrong; open the complete URL that `s2r serve` printed\n"
            )


def url_host(host: str) -> str:
    """Return a host as it is written in a URL: IPv6 addresses in brackets."""
    return f"[{host}]" if ":" in host else host
