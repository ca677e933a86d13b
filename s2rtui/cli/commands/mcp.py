"""`s2r mcp`: serve a store to agents by the Model Context Protocol."""

from __future__ import annotations

import argparse
import os
import secrets
import signal
import sys

import s2rstore
from s2rstore.errors import RequestError, missing_package
from s2rtools.common.command_line import store_argument
from s2rtui.cli.interrupts import EXIT_CODE

EXAMPLE = "s2r mcp lab.s2r"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("--allow-write", choices=("notes",),
                        help="also offer a tool that writes notes of instances into your "
                        "notebook")  # fmt: skip
    parser.add_argument("--http", type=int, metavar="PORT",
                        help="serve streamable HTTP on 127.0.0.1 with a token, in place of the "
                        "standard streams")  # fmt: skip


def execute(options: argparse.Namespace) -> int:
    try:
        from s2rtui.cli.mcp_server import bound, build_server, serve_http
    except ModuleNotFoundError as error:
        if error.name != "mcp":
            raise
        raise missing_package("mcp", "mcp") from None
    if options.http is not None and not 0 < options.http < 1 << 16:
        raise RequestError(f"--http {options.http}: expected a port, 1 to 65535")
    s2rstore.open(options.store).close()  # a store that cannot be read is told before any client
    server = build_server(str(options.store), options.allow_write == "notes")
    if options.http is None:
        signal.signal(signal.SIGINT, lambda *_: os._exit(EXIT_CODE))  # a thread waits for input
        try:
            server.run("stdio")
        except* OSError:  # the client has closed its end
            os._exit(0)
        return 0
    address = bound(options.http)
    token = secrets.token_urlsafe(24)
    print(f"http://127.0.0.1:{options.http}/mcp", file=sys.stderr)
    print(f"Authorization: Bearer {token}", file=sys.stderr, flush=True)
    serve_http(server, address, token)
    return 0
