"""`s2r serve`: the application on a store, in a browser on this machine."""

from __future__ import annotations

import argparse
import ipaddress
import os
from pathlib import Path

_INSTALL = "needs textual-serve; install it with `pip install 's2rtui[serve]'`"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=Path)
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on")
    parser.add_argument("--port", type=int, default=8000)
    parser.add_argument("--users", type=int, default=8, help="pages at a time (default 8)")
    parser.add_argument(
        "--public", action="store_true",
        help="allow other addresses than loopback: whoever has the address with its token "
        "reads the store, and nothing is encrypted",
    )  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.errors import RequestError

    _check(options)
    s2rstore.open(options.store).close()
    try:
        from s2rtui.web.server import Served, StoreServer
    except ModuleNotFoundError as error:
        raise RequestError(f"serve: {error.name} is missing; it {_INSTALL}") from error
    _prepare_environment()
    where = options.host, options.port
    served = Served(options.store, *where, options.users, options.public)
    try:
        StoreServer(served).serve()
    except OSError as error:
        told = f"{options.host}:{options.port}: cannot be listened on"
        raise RequestError(
            f"{told} ({os.strerror(error.errno or 0)}); try another --port"
        ) from error
    return 0


def _check(options: argparse.Namespace) -> None:
    from s2rstore.errors import RequestError

    if not 1 <= options.port <= 65535:
        raise RequestError(f"--port {options.port}: 1 .. 65535")
    if options.users < 1:
        raise RequestError(f"--users {options.users}: at least 1")
    if not options.public and not _is_loopback(options.host):
        raise RequestError(
            f"--host {options.host}: others could reach it, and nothing is encrypted; "
            "keep 127.0.0.1 and use `ssh -L`, or give --public where that is meant"
        )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _prepare_environment() -> None:
    """The terminal in the page is always the same, whatever this one is."""
    os.environ.pop("NO_COLOR", None)
    os.environ.update(TERM="xterm-256color", COLORTERM="truecolor", LC_ALL="C.UTF-8")
