"""URLs of stores."""

from __future__ import annotations

import re
from pathlib import PosixPath
from typing import NoReturn
from urllib.parse import urlsplit

from s2rstore.errors import RequestError

SCHEMES = ("s3", "https", "http")
_URL = re.compile(r"([a-z][a-z0-9+.-]*)://", re.IGNORECASE)
_BUCKET = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,254}\Z")
_REFUSED = re.compile(r"[\x00-\x20\x7f\\]")


class StoreUrl(PosixPath):
    """The URL of a store, or of a file in it, as a path that no function of the system opens.

    `/`, `name` and the text in messages are those of a path, so that code which only names files
    treats stores in folders and on servers alike. Code that would open or write a file fails with a
    RequestError: a store on a server is never written by its path.
    """

    def __str__(self) -> str:
        return super().__str__().replace(":/", "://", 1)

    def __fspath__(self) -> NoReturn:
        raise RequestError(
            f"{self}: a store on a server is only read; this needs a copy of it in a folder"
        )

    def absolute(self) -> StoreUrl:
        """The URL itself, which is absolute."""
        return self

    def resolve(self, strict: bool = False) -> StoreUrl:
        """The URL itself; where a server redirects to does not name the store."""
        return self

    @property
    def scheme(self) -> str:
        return self.parts[0].rstrip(":").lower()

    @property
    def host(self) -> str:
        """The host with its port, or the bucket of an s3 URL."""
        return self.parts[1]

    @property
    def key(self) -> str:
        """The path on the host or in the bucket, without a slash at either end."""
        return "/".join(self.parts[2:])


def is_url(text: str) -> bool:
    """Whether a text begins like a URL of any scheme."""
    return _URL.match(text) is not None


def parse_url(text: str) -> StoreUrl:
    """The URL of a store. Raises RequestError, which never repeats a password."""
    match = _URL.match(text)
    scheme = match[1].lower() if match else ""
    if scheme not in SCHEMES:
        known = ", ".join(f"{each}://" for each in SCHEMES)
        raise RequestError(f"{text[:200]}: not a folder and not a URL that begins with {known}")
    try:
        parts = urlsplit(text)
        parts.port  # noqa: B018 - raises ValueError where it is no number
    except ValueError as error:
        raise RequestError(f"{scheme}://...: not a valid URL ({error})") from error
    if parts.username is not None or parts.password is not None:
        raise RequestError(
            f"{scheme}://...: a user name or password in a URL is not read; "
            "credentials come from the environment (AWS_ACCESS_KEY_ID ...)"
        )
    if "?" in text or "#" in text:
        raise RequestError(f"{scheme}://{parts.netloc}...: give a URL without ? and #")
    path = parts.path.strip("/")
    if _REFUSED.search(text) or {"", ".", ".."} & set(path.split("/") if path else ()):
        raise RequestError(f"{text[:200]!r}: not the URL of a store; check its path")
    if not (_BUCKET.match(parts.netloc) if scheme == "s3" else parts.hostname):
        raise RequestError(f"{text[:200]!r}: names no {'bucket' if scheme == 's3' else 'host'}")
    return StoreUrl(f"{scheme}:", parts.netloc, *(path.split("/") if path else ()))
