"""Requests to an S3 server for the objects of a store, with bounded time, retries and sizes.

`obstore` sends the requests and repeats those that fail on the way. Its errors become one line that
names the object and the cause: what a server or a library says is never shown, because it may be of
any length and hold addresses or keys.
"""

from __future__ import annotations

import errno
import math
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from s2rstore.errors import RequestError, UnreachableStoreError, shortened
from s2rstore.remote.store_url import StoreUrl

if TYPE_CHECKING:
    from obstore import PutMode
    from obstore.store import ClientConfig, RetryConfig, S3Store

TIMEOUT_VARIABLE = "S2R_REMOTE_TIMEOUT"
"""Environment variable with the seconds that one request may take."""
DEFAULT_TIMEOUT = 20.0
MAX_RETRIES = 3

CONNECT_SECONDS = 5.0
WHOLE_BYTES = 64 * 2**20
"""Objects up to this size are read whole from a server that ignores byte ranges."""
_MAX_LISTED = 5_000_000
_CREDENTIALS = (
    "AWS_ACCESS_KEY_ID", "AWS_WEB_IDENTITY_TOKEN_FILE", "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI", "AWS_SKIP_SIGNATURE",
)  # fmt: skip
_ENDPOINTS = ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT")
_CLOSED = re.compile(r"hyper::Error\(\s*IncompleteMessage\b")
_NO_HTTP = re.compile(r"hyper::Error\(\s*Parse\b")
_SENT = ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_TOKEN",
         "AWS_REGION", "AWS_DEFAULT_REGION")  # fmt: skip
_SENDABLE = re.compile(r"[!-~]*")
_SERVER = re.compile(r"https?://[A-Za-z0-9._:\[\]-]+(/[A-Za-z0-9._~/-]*)?")
_KIND = re.compile(r"kind: (Timeout|TimedOut|Connect|Interrupted)\b")
_PANIC_MODULE = "pyo3_runtime"
"""Module of the exception that a panic of obstore's Rust code raises; it is no `Exception`."""
_NO_SUCH_RANGE = "416"
"""Status of a request for a part of an empty object."""
_CONFLICT, _NOT_IMPLEMENTED = "409", "501"
_CONDITION_STATUS = (_CONFLICT, _NOT_IMPLEMENTED)
"""Status where another writer came first, and where the server knows no conditions."""
_STATUS = re.compile(r"status(?: code)?: (\d{3})\b")


@dataclass(frozen=True, slots=True)
class ObjectFacts:
    """Size and version of an object; `etag` is empty where the server states none."""

    bytes: int
    etag: str
    modified_ns: int


def missing_package(url: StoreUrl, error: ModuleNotFoundError) -> RequestError:
    """The error of a remote store whose Python package is not installed."""
    return RequestError(
        f"{url}: reading from a server needs the Python package {error.name}; "
        "install it with `pip install 's2rtui[remote]'`"
    )


class ObjectClient:
    """The objects below a URL, by their paths relative to it; any thread may use it."""

    can_list = True

    def __init__(self, url: StoreUrl) -> None:
        self.url = url
        self._timeout = timeout()
        self._store = self._connect()

    def _connect(self) -> S3Store:
        """The store of obstore; the first request opens the first connection."""
        try:
            from obstore.store import S3Store
        except ModuleNotFoundError as error:
            raise missing_package(self.url, error) from error
        endpoint = _endpoint()
        client: ClientConfig = {
            "timeout": timedelta(seconds=self._timeout),
            "connect_timeout": timedelta(seconds=min(CONNECT_SECONDS, self._timeout)),
            "allow_http": (endpoint or "").lower().startswith("http:"),
            "user_agent": "s2rtui",
        }
        retry: RetryConfig = {
            "max_retries": MAX_RETRIES,
            "retry_timeout": timedelta(seconds=2 * self._timeout),
            "backoff": {"init_backoff": timedelta(milliseconds=100),
                        "max_backoff": timedelta(seconds=2), "base": 2},
        }  # fmt: skip
        with self._explained(""):
            settings: dict[str, Any] = {"endpoint": endpoint} if endpoint else {}
            if not _has_credentials():
                settings["skip_signature"] = True
            _check_credentials()
            return S3Store(
                self.url.host, prefix=self.url.key or None, client_options=client,
                retry_config=retry, **settings,
            )  # fmt: skip

    def head(self, name: str) -> ObjectFacts:
        """Size and version of an object. FileNotFoundError where there is none."""
        import obstore

        with self._explained(name):
            return _facts(obstore.head(self._store, name))

    def attributes(self, name: str) -> tuple[ObjectFacts, dict[str, str]]:
        """Size and version of an object, and the values that were stored with it."""
        import obstore

        with self._explained(name):
            found = obstore.get(self._store, name, options={"head": True})
            return _facts(found.meta), {str(k): str(v) for k, v in found.attributes.items()}

    def whole(self, name: str, limit: int) -> tuple[bytes, ObjectFacts]:
        """The content of an object; RequestError where it has more than `limit` bytes."""
        import obstore

        with self._explained(name):
            found = obstore.get(self._store, name)
            facts, content = _facts(found.meta), bytearray()
            if facts.bytes <= limit:
                for block in found.stream(min_chunk_size=1 << 16):
                    content += block
                    if len(content) > limit:
                        break
        if max(facts.bytes, len(content)) > limit:
            size = max(facts.bytes, len(content))
            raise RequestError(f"{self.url / name}: {size} bytes, at most {limit} are read")
        return bytes(content), facts

    def piece(self, name: str, start: int, length: int) -> tuple[bytes, ObjectFacts]:
        """`length` bytes of an object from `start` on, fewer at its end.

        A negative `start` counts from the end.
        """
        import obstore
        from obstore.exceptions import GenericError, NotSupportedError

        wanted: Any = (start, start + length) if start >= 0 else {"suffix": -start}
        with self._explained(name):
            try:
                found = obstore.get(self._store, name, options={"range": wanted})
            except NotSupportedError:
                found = None
            except GenericError as error:
                status = _STATUS.search(str(error))
                if status is None or status[1] != _NO_SUCH_RANGE:
                    raise
                return b"", _facts(obstore.head(self._store, name))
            if found is not None:
                facts, (low, high) = _facts(found.meta), found.range
                if high - low > length:
                    raise RequestError(f"{self.url / name}: the server sent more than was asked")
                return bytes(found.bytes()), facts
        content, facts = self.whole(name, WHOLE_BYTES)
        begin = start if start >= 0 else max(facts.bytes + start, 0)
        return content[begin : begin + length], facts

    def listed(self, folder: str, deeply: bool) -> Iterator[tuple[str, ObjectFacts | None]]:
        """The objects in a folder by their paths, and without `deeply` its folders with None."""
        import obstore

        prefix = folder or None
        with self._explained(folder):
            if not deeply:
                found = obstore.list_with_delimiter(self._store, prefix)
                yield from ((path, None) for path in found["common_prefixes"])
                yield from ((each["path"], _facts(each)) for each in found["objects"])
                return
            count = 0
            for group in obstore.list(self._store, prefix, chunk_size=1000):
                count += len(group)
                if count > _MAX_LISTED:
                    raise RequestError(f"{self.url}: more than {_MAX_LISTED} objects; not a store")
                yield from ((each["path"], _facts(each)) for each in group)

    def put(self, name: str, content: Any, attributes: Mapping[str, str]) -> None:
        """Create or replace an object; readers see its old content or the new, never a part.

        `content` is bytes or the path of a file, which is sent in parts where it is large.
        """
        import obstore

        with self._explained(name, "written"):
            obstore.put(self._store, name, content, attributes=dict(attributes))

    def put_unless_changed(
        self, name: str, content: bytes, attributes: Mapping[str, str], etag: str | None
    ) -> bool:
        """Replace the version `etag` of an object, or create it where `etag` is None.

        False, and nothing is written, where the object has another version or, for None, exists.
        A server that knows no conditions, or stated an empty or weak `etag`, replaces any version.
        """
        import obstore
        from obstore.exceptions import (
            AlreadyExistsError,
            BaseError,
            NotFoundError,
            PreconditionError,
        )

        if etag is not None and (not etag or etag.startswith("W/")):
            self.put(name, content, attributes)
            return True
        mode: PutMode = "create" if etag is None else {"e_tag": etag}
        with self._explained(name, "written"):
            try:
                obstore.put(self._store, name, content, attributes=dict(attributes), mode=mode)
            except (AlreadyExistsError, NotFoundError, PreconditionError):
                return False
            except BaseError as error:
                status = _STATUS.search(str(error))
                if status is None or status[1] not in _CONDITION_STATUS:
                    raise
                if status[1] == _CONFLICT:
                    return False
                obstore.put(self._store, name, content, attributes=dict(attributes))
        return True

    @contextmanager
    def _explained(self, name: str, done: str = "read") -> Iterator[None]:
        """Errors of obstore as those that `StoreFiles` promises."""
        from obstore.exceptions import (
            BaseError,
            PermissionDeniedError,
            UnauthenticatedError,
        )

        where = str(self.url / name) if name else str(self.url)
        try:
            yield
        except FileNotFoundError as error:
            raise FileNotFoundError(errno.ENOENT, "not found (404)", where) from error
        except (PermissionDeniedError, UnauthenticatedError) as error:
            is_login = isinstance(error, UnauthenticatedError)
            reason = "the server asks for a login, 401" if is_login else "access denied, 403"
            message = f"{where}: cannot be {done} ({reason}){self._permission_hint}"
            raise UnreachableStoreError(message) from error
        except (BaseError, ValueError, OSError) as error:
            reason = self._reason(str(error))
            raise UnreachableStoreError(f"{where}: cannot be {done} ({reason})") from error
        except BaseException as error:
            if type(error).__module__ != _PANIC_MODULE:
                raise
            reason = "obstore failed; check the URL and the variables AWS_..."
            raise UnreachableStoreError(f"{where}: cannot be {done} ({reason})") from error

    @property
    def _permission_hint(self) -> str:
        """What a user can do about a refused request."""
        if _has_credentials():
            return "; check the rights of the key in AWS_ACCESS_KEY_ID"
        return "; set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY"

    def _reason(self, text: str) -> str:
        """The cause of an error of obstore in words."""
        status, kind = _STATUS.search(text), _KIND.search(text)
        if status is not None:
            return f"the server answered {status[1]}"
        if kind is not None and kind[1] in ("Timeout", "TimedOut"):
            return f"no answer within {self._timeout:g} s; {TIMEOUT_VARIABLE} sets another time"
        if kind is not None and kind[1] == "Connect":
            return "no connection to the server; check the address and the network"
        if kind is not None:
            return "the connection was cut; try again"
        if _CLOSED.search(text):
            return "the server closed the connection without an answer; try again"
        if _NO_HTTP.search(text):
            return "what answers is no web server, or one with TLS; check port and http(s)://"
        return "the server gave an unexpected answer"


def _endpoint() -> str | None:
    """The server that the environment names; None for Amazon's.

    Raises RequestError for a text that is no URL, at which obstore would end the process.
    """
    name = next((name for name in _ENDPOINTS if os.environ.get(name)), None)
    if name is None:
        return None
    text = os.environ[name]
    try:
        parts = urlsplit(text)
        is_url = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        is_url = False
    if not is_url or not _SERVER.fullmatch(text):
        shown = "..." if "@" in text else shortened(text)
        raise RequestError(f"{name}={shown}: not the URL of a server, such as https://minio:9000")
    return text


def _check_credentials() -> None:
    """Raise RequestError for keys and regions with characters that no request may have."""
    for name in _SENT:
        if not _SENDABLE.fullmatch(os.environ.get(name, "")):
            raise RequestError(
                f"{name}: has a blank, a line break or another character that no key and no region "
                "has; set it again"
            )


def _has_credentials() -> bool:
    """Whether the environment says how to sign requests, or not to."""
    return any(os.environ.get(name) for name in _CREDENTIALS)


def timeout() -> float:
    """Seconds that one request may take, from the environment or the default."""
    text = os.environ.get(TIMEOUT_VARIABLE, "")
    try:
        seconds = float(text) if text else DEFAULT_TIMEOUT
    except ValueError:
        seconds = math.nan
    if not 0.1 <= seconds <= 3600:
        raise RequestError(f"{TIMEOUT_VARIABLE}={text[:40]}: must be seconds from 0.1 to 3600")
    return seconds


def _facts(meta: Any) -> ObjectFacts:
    modified = meta["last_modified"]
    seconds = modified.timestamp() if modified is not None else 0.0
    return ObjectFacts(int(meta["size"]), meta["e_tag"] or "", int(seconds * 1e9))
