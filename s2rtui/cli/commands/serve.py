"""`s2r serve`: serve the application on a store to browsers on this machine."""

from __future__ import annotations

import argparse
import ipaddress
import os

import s2rstore
from s2rstore.errors import RequestError
from s2rtools.common.command_line import store_argument

EXAMPLE = "s2r serve lab.s2r --port 8000"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store", type=store_argument.folder, help="store folder")
    add = parser.add_argument_group("network").add_argument
    add("--host", default="127.0.0.1", help="address to listen on (default 127.0.0.1)")
    add("--port", type=int, default=8000, help="TCP port (default 8000)")
    add("--users", type=int, default=8, help="sessions at the same time (default 8)")
    add("--public", action="store_true",
        help="allow an address other than loopback; everybody who has the address with its token "
        "can read the store, and the connection is not encrypted")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    _check(options)
    s2rstore.open(options.store).close()
    try:
        from s2rtui.web.server import StoreServer
    except ModuleNotFoundError as error:
        raise RequestError(
            f"serve: the Python package {error.name} is missing; "
            "install it with `pip install 's2rtui[serve]'`"
        ) from error
    # The terminal in the page does not depend on this one.
    os.environ.pop("NO_COLOR", None)
    os.environ.update(TERM="xterm-256color", COLORTERM="truecolor", LC_ALL="C.UTF-8")
    address = options.host, options.port
    try:
        StoreServer(options.store, *address, options.users, options.public).serve()
    except OSError as error:
        reason = os.strerror(error.errno or 0)
        raise RequestError(
            f"{options.host}:{options.port}: cannot listen ({reason}); try another --port"
        ) from error
    return 0


def _check(options: argparse.Namespace) -> None:
    if not 1 <= options.port <= 65535:
        raise RequestError(f"--port {options.port}: must be 1 to 65535")
    if options.users < 1:
        raise RequestError(f"--users {options.users}: must be at least 1")
    if not options.public and not _is_loopback(options.host):
        raise RequestError(
            f"--host {options.host}: is reachable from other machines, without "
            "encryption; use 127.0.0.1 with `ssh -L`, or confirm with --public"
        )


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
