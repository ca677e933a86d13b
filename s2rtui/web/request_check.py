"""Who is let in: requests that name this server strictly, from its own pages, with its token."""

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
    """What a request must show; `hosts` are the names allowed in it, None for any.

    The port is free, so that the page works through a tunnel. The token is random for each start
    of a server.
    """

    hosts: tuple[str, ...] | None = LOOPBACK
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)

    def check_address(self, request: web.Request) -> None:
        """Refuse other hosts, and pages of other sites; HTTPBadRequest for a malformed host."""
        given = request.headers.getall("Host", [])
        found = _HOST.fullmatch(given[0]) if len(given) == 1 else None
        if found is None or (found[2] is not None and not 1 <= int(found[2]) <= 65535):
            raise web.HTTPBadRequest(text="malformed Host header\n")
        if self.hosts is not None and found[1].lower() not in self.hosts:
            raise web.HTTPForbidden(text="this server answers to loopback names only\n")
        for origin in request.headers.getall("Origin", []):
            if origin.lower() != f"{request.scheme}://{given[0].lower()}":
                raise web.HTTPForbidden(text="pages of other sites are not let in\n")

    def check_token(self, given: str) -> None:
        """HTTPForbidden for any text but the token."""
        if not hmac.compare_digest(given.encode("utf-8", "replace"), self.token.encode()):
            raise web.HTTPForbidden(
                text="token missing or wrong: open the whole address that `s2r serve` printed\n"
            )


def in_address(host: str) -> str:
    """A host as it stands in an address: IPv6 in brackets."""
    return f"[{host}]" if ":" in host else host
