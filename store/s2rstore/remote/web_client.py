"""Requests to a web server for the files of a store, with bounded time, retries, sizes and hosts.

`urllib3` sends the requests. A redirect to another host is followed only where the user allows it:
a server could otherwise make this program read from machines that only this one reaches. Errors
become one line that names the file and the cause; of what the server says, only the host of a
redirect is shown.
"""

from __future__ import annotations

import errno
import math
import os
import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from email.utils import parsedate_to_datetime
from http.client import BadStatusLine, RemoteDisconnected
from typing import TYPE_CHECKING, TypeVar
from urllib.parse import quote, urljoin, urlsplit
from urllib.request import getproxies, proxy_bypass

from s2rstore.errors import RequestError, UnreachableStoreError, shortened
from s2rstore.remote.object_client import (
    CONNECT_SECONDS,
    MAX_RETRIES,
    TIMEOUT_VARIABLE,
    WHOLE_BYTES,
    ObjectFacts,
    missing_package,
    timeout,
)
from s2rstore.remote.store_url import StoreUrl
from s2rstore.security.printable_text import printable

if TYPE_CHECKING:
    from urllib3 import BaseHTTPResponse, PoolManager

T = TypeVar("T")

REDIRECTS_VARIABLE = "S2R_REMOTE_REDIRECTS"
"""Environment variable: `1` follows redirects to other hosts."""
_MAX_REDIRECTS = 5
_MAX_CONNECTIONS = 16
_BLOCK_BYTES = 1 << 16
_FIRST_PAUSE = 0.1
_PORTS = {"http": 80, "https": 443}
_REDIRECTS = (301, 302, 303, 307, 308)
_OK, _PARTIAL, _NOT_FOUND, _NO_SUCH_RANGE, _FAILING = 200, 206, 404, 416, 500
_REFUSALS = {401: "the server asks for a login, 401", 403: "access denied, 403"}
_CONTENT_RANGE = re.compile(r"bytes (\d{1,18})-(\d{1,18})/(\d{1,18})\Z")


class _FailedRequestError(Exception):
    """A request that failed, with the cause in words; repeated if it `may_pass`."""

    def __init__(self, reason: str, may_pass: bool = False) -> None:
        super().__init__(reason)
        self.may_pass = may_pass


class WebClient:
    """The files below a URL of a web server, by their paths relative to it; for any thread."""

    can_list = False

    def __init__(self, url: StoreUrl) -> None:
        self.url = url
        self._timeout = timeout()
        self._follows_all = _follows_all()
        self._pool = self._connect()

    def _connect(self) -> PoolManager:
        """The pool of connections; the first request opens the first one."""
        try:
            import urllib3
        except ModuleNotFoundError as error:
            raise missing_package(self.url, error) from error
        host = urlsplit(str(self.url)).hostname or ""
        address = None if proxy_bypass(host) else getproxies().get(self.url.scheme)
        try:
            if address:
                proxy = urllib3.util.parse_url(address)
                headers = urllib3.make_headers(proxy_basic_auth=proxy.auth) if proxy.auth else {}
                return urllib3.ProxyManager(
                    address, maxsize=_MAX_CONNECTIONS, proxy_headers=headers
                )
        except (urllib3.exceptions.HTTPError, ValueError) as error:
            name = f"{self.url.scheme.upper()}_PROXY"
            raise RequestError(f"{name}: not the URL of a proxy; set it again") from error
        return urllib3.PoolManager(maxsize=_MAX_CONNECTIONS)

    def head(self, name: str) -> ObjectFacts:
        """Size and version of a file. FileNotFoundError where there is none."""

        def read(response: BaseHTTPResponse, deadline: float) -> ObjectFacts:
            response.drain_conn()  # there is no body
            return _facts(response, None)

        return self._request("HEAD", name, {}, read)

    def whole(self, name: str, limit: int) -> tuple[bytes, ObjectFacts]:
        """The content of a file; RequestError where it has more than `limit` bytes."""

        def read(response: BaseHTTPResponse, deadline: float) -> tuple[bytes, ObjectFacts]:
            return self._read_whole(response, deadline, name, limit)

        return self._request("GET", name, {}, read)

    def _read_whole(
        self, response: BaseHTTPResponse, deadline: float, name: str, limit: int
    ) -> tuple[bytes, ObjectFacts]:
        stated = response.headers.get("Content-Length", "")
        size = int(stated) if stated.isascii() and stated.isdigit() else 0
        content = b"" if size > limit else self._body(response, limit, deadline)
        if max(size, len(content)) > limit:
            shown = max(size, len(content))
            raise RequestError(f"{self.url / name}: {shown} bytes, at most {limit} are read")
        return content, _facts(response, len(content))

    def piece(self, name: str, start: int, length: int) -> tuple[bytes, ObjectFacts]:
        """`length` bytes of a file from `start` on, fewer at its end.

        A negative `start` counts from the end.
        """
        wanted = f"bytes={start}-{start + length - 1}" if start >= 0 else f"bytes={start}"

        def read(response: BaseHTTPResponse, deadline: float) -> tuple[bytes, ObjectFacts]:
            if response.status == _NO_SUCH_RANGE:
                return b"", self.head(name)
            if response.status != _PARTIAL:  # the server ignores byte ranges
                content, facts = self._read_whole(response, deadline, name, WHOLE_BYTES)
                begin = start if start >= 0 else max(facts.bytes + start, 0)
                return content[begin : begin + length], facts
            match = _CONTENT_RANGE.match(response.headers.get("Content-Range", ""))
            if match is None:
                raise _FailedRequestError("the server gave an unexpected answer")
            low, high, size = map(int, match.groups())
            content = self._body(response, length, deadline)
            if max(high + 1 - low, len(content)) > length:
                raise RequestError(f"{self.url / name}: the server sent more than was asked")
            return content, _facts(response, size)

        return self._request("GET", name, {"Range": wanted}, read)

    def listed(self, folder: str, deeply: bool) -> Iterator[tuple[str, ObjectFacts | None]]:
        """Raise RequestError: web servers list no files."""
        raise RequestError(f"{self.url / folder}: a web server lists no files")

    def _body(self, response: BaseHTTPResponse, limit: int, deadline: float) -> bytes:
        """The body, or a longer part of it than `limit`."""
        content = bytearray()
        while len(content) <= limit and (block := response.read1(_BLOCK_BYTES)):
            content += block
            if time.monotonic() > deadline:
                raise _FailedRequestError(self._no_answer)
        return bytes(content)

    @property
    def _no_answer(self) -> str:
        return f"no answer within {self._timeout:g} s; {TIMEOUT_VARIABLE} sets another time"

    def _request(
        self,
        method: str,
        name: str,
        headers: Mapping[str, str],
        read: Callable[[BaseHTTPResponse, float], T],
    ) -> T:
        """What `read` makes of the answer; passing failures are repeated."""
        where, pause = str(self.url / name), _FIRST_PAUSE
        end = time.monotonic() + 2 * self._timeout
        for attempt in range(MAX_RETRIES + 1):
            try:
                return self._answer(method, f"{self.url}/{quote(name)}", headers, read, where)
            except _FailedRequestError as failure:
                is_last = attempt == MAX_RETRIES or time.monotonic() + pause > end
                if is_last or not failure.may_pass:
                    message = f"{where}: cannot be read ({failure})"
                    raise UnreachableStoreError(message) from failure
            time.sleep(pause)
            pause *= 2
        raise AssertionError

    def _answer(
        self,
        method: str,
        address: str,
        headers: Mapping[str, str],
        read: Callable[[BaseHTTPResponse, float], T],
        where: str,
    ) -> T:
        """One attempt, with its redirects."""
        deadline = time.monotonic() + self._timeout
        for _ in range(_MAX_REDIRECTS + 1):
            with self._sent(method, address, headers) as response:
                status = response.status
                if status in _REDIRECTS:
                    address = self._redirected(address, response.headers.get("Location", ""))
                    continue
                if status == _NOT_FOUND:
                    raise FileNotFoundError(errno.ENOENT, "not found (404)", where)
                if status in _REFUSALS:
                    raise _FailedRequestError(_REFUSALS[status])
                if status not in (_OK, _PARTIAL, _NO_SUCH_RANGE):
                    raise _FailedRequestError(f"the server answered {status}", status >= _FAILING)
                return read(response, deadline)
        raise _FailedRequestError(f"more than {_MAX_REDIRECTS} redirects")

    def _redirected(self, address: str, location: str) -> str:
        """Where a redirect leads. _FailedRequestError for another host that is not allowed."""
        try:
            target = urljoin(address, location)
            old, new = _origin(str(self.url)), _origin(target)
        except ValueError:
            raise _FailedRequestError("the server gave an unexpected answer") from None
        if new[0] not in _PORTS or not new[1]:
            raise _FailedRequestError("the server redirects to what is no web server")
        is_upgrade = old == ("http", new[1], _PORTS["http"]) and new[2] == _PORTS["https"]
        if new != old and not (is_upgrade or self._follows_all):
            host = printable(shortened(f"{new[0]}://{new[1]}:{new[2]}"))
            raise _FailedRequestError(
                f"the server redirects to another one, {host}; give a URL of that server, or allow "
                f"it by {REDIRECTS_VARIABLE}=1"
            )
        return target

    @contextmanager
    def _sent(
        self, method: str, address: str, headers: Mapping[str, str]
    ) -> Iterator[BaseHTTPResponse]:
        """The answer to a request, before its body; its errors become _FailedRequestError."""
        import urllib3
        from urllib3.exceptions import (
            ConnectTimeoutError,
            HTTPError,
            NewConnectionError,
            ProtocolError,
            ProxyError,
            ReadTimeoutError,
            SSLError,
        )

        limits = urllib3.Timeout(min(CONNECT_SECONDS, self._timeout), self._timeout)
        sent = {"User-Agent": "s2rtui", "Accept-Encoding": "identity", **headers}
        response: BaseHTTPResponse | None = None
        try:
            response = self._pool.request(
                method, address, headers=sent, timeout=limits, redirect=False, retries=False,
                preload_content=False,
            )  # fmt: skip
            yield response
        except (NewConnectionError, ConnectTimeoutError, ProxyError) as error:
            reason = "no connection to the server; check the address and the network"
            raise _FailedRequestError(reason, may_pass=True) from error
        except ReadTimeoutError as error:
            raise _FailedRequestError(self._no_answer, may_pass=True) from error
        except SSLError as error:
            reason = "no TLS connection; check the certificate, the port and http(s)://"
            raise _FailedRequestError(reason) from error
        except ProtocolError as error:
            raise _of_protocol(error, response is not None) from error
        except (HTTPError, ValueError) as error:
            raise _FailedRequestError("the server gave an unexpected answer") from error
        finally:
            if response is not None:
                response.close()  # one that is read to its end has given its connection back


def _of_protocol(error: Exception, is_answered: bool) -> _FailedRequestError:
    """The failure that an answer which is cut, or is no HTTP, means."""
    cause = error.args[1] if len(error.args) > 1 else None
    if not is_answered and isinstance(cause, RemoteDisconnected):
        reason = "the server closed the connection without an answer; try again"
        return _FailedRequestError(reason, may_pass=True)
    if not is_answered and isinstance(cause, BadStatusLine):
        return _FailedRequestError(
            "what answers is no web server, or one with TLS; check port and http(s)://"
        )
    return _FailedRequestError("the connection was cut; try again", may_pass=True)


def _origin(address: str) -> tuple[str, str, int]:
    """Scheme, host and port of a URL. Raises ValueError where the port is no number."""
    parts = urlsplit(address)
    scheme = parts.scheme.lower()
    return scheme, (parts.hostname or "").lower(), parts.port or _PORTS.get(scheme, 0)


def _follows_all() -> bool:
    text = os.environ.get(REDIRECTS_VARIABLE, "")
    if text not in ("", "0", "1"):
        raise RequestError(f"{REDIRECTS_VARIABLE}={shortened(text)}: must be 0 or 1")
    return text == "1"


def _facts(response: BaseHTTPResponse, size: int | None) -> ObjectFacts:
    """Size, by default that of the body, and version of a file."""
    if size is None:
        stated = response.headers.get("Content-Length", "")
        if not (stated.isascii() and stated.isdigit()):
            raise _FailedRequestError("the server does not state the size")
        size = int(stated)
    try:
        modified = parsedate_to_datetime(response.headers.get("Last-Modified", "")).timestamp()
    except (ValueError, TypeError, OverflowError):
        modified = 0.0
    seconds = modified if math.isfinite(modified) else 0.0
    return ObjectFacts(size, response.headers.get("ETag", ""), int(seconds * 1e9))
