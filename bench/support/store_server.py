"""A web server on loopback that serves a store with byte ranges, and fails when it is told to."""

from __future__ import annotations

import re
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

Fault = Literal[
    "missing", "denied", "login", "failing", "cut", "closed", "garbled", "slow", "whole"
]
"""404, 403, 401, 503, a connection that is cut within the body or closed without an answer, an
answer that is not HTTP, an answer that comes too late, and a server that ignores byte ranges."""

SLOW_SECONDS = 30.0
_RANGE = re.compile(r"bytes=(\d*)-(\d*)\Z")


@dataclass
class StoreServer:
    """The server's address, what it was asked, and the faults of paths, which may be changed.

    `faults` maps a pattern of paths to a fault and to how often it occurs, `moved` the begin of
    paths to the URL that they are redirected to.
    """

    url: str
    root: Path
    requests: list[tuple[str, str]] = field(default_factory=list)
    faults: dict[str, tuple[Fault, float]] = field(default_factory=dict)
    released: threading.Event = field(default_factory=threading.Event)
    moved: dict[str, str] = field(default_factory=dict)

    def fail(self, pattern: str, fault: Fault, times: float = float("inf")) -> None:
        """Fail requests for the paths that a regular expression finds."""
        self.faults[pattern] = (fault, times)

    def heal(self) -> None:
        self.faults.clear()

    def fault_of(self, path: str) -> Fault | None:
        for pattern, (fault, times) in self.faults.items():
            if times > 0 and re.search(pattern, path):
                self.faults[pattern] = (fault, times - 1)
                return fault
        return None

    @property
    def methods(self) -> set[str]:
        return {method for method, _ in self.requests}


@contextmanager
def store_server(folder: Path) -> Iterator[StoreServer]:
    """Serve the files below a folder until the context ends."""
    server: StoreServer

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True  # else a body waits 40 ms for the receipt of its header

        def do_GET(self) -> None:
            self._answer(with_body=True)

        def do_HEAD(self) -> None:
            self._answer(with_body=False)

        def __getattr__(self, name: str) -> object:
            if name.startswith("do_"):  # every other method is recorded and refused
                return lambda: (self._record(), self.send_error(405))
            raise AttributeError(name)

        def _record(self) -> str:
            path = unquote(self.path).lstrip("/")
            server.requests.append((self.command, path))
            return path

        def _answer(self, with_body: bool) -> None:
            path = self._record()
            fault = server.fault_of(path)
            if fault == "slow":
                server.released.wait(SLOW_SECONDS)
                self.close_connection = True
                return
            if fault in ("closed", "garbled"):
                self.wfile.write(b"hello\r\n\r\n" if fault == "garbled" else b"")
                self.close_connection = True
                return
            for begin, target in server.moved.items():
                if path.startswith(begin):
                    self.send_response(302)
                    self.send_header("Location", target + path.removeprefix(begin))
                    self.send_header("Content-Length", "0")
                    self.end_headers()
                    return
            codes = {"missing": 404, "denied": 403, "login": 401, "failing": 503}
            file = folder / path
            if fault in codes or ".." in path or not file.is_file():
                self.send_error(codes.get(str(fault), 404))
                return
            status = file.stat()
            size = status.st_size
            start, stop = self._range(size) if fault != "whole" else (0, size)
            is_part = "Range" in self.headers and fault != "whole"
            if is_part and start >= size:
                self.send_error(416)
                return
            with file.open("rb") as content:
                content.seek(start)
                body = content.read(stop - start)
            self.send_response(206 if is_part else 200)
            if is_part:
                self.send_header("Content-Range", f"bytes {start}-{stop - 1}/{size}")
            self.send_header("Content-Length", str(len(body)))
            self.send_header("ETag", f'"{status.st_mtime_ns:x}-{size:x}"')
            self.send_header("Last-Modified", self.date_time_string(int(status.st_mtime)))
            self.end_headers()
            if with_body:
                self.wfile.write(body[: len(body) // 2] if fault == "cut" else body)
            self.close_connection |= fault == "cut"

        def _range(self, size: int) -> tuple[int, int]:
            match = _RANGE.match(self.headers.get("Range", ""))
            if match is None:
                return 0, size
            first, last = match.groups()
            if not first:
                return max(size - int(last), 0), size
            return int(first), min(int(last) + 1, size) if last else size

        def log_message(self, format: str, *args: object) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as http:
        http.daemon_threads = True
        server = StoreServer(f"http://127.0.0.1:{http.server_port}", folder)
        thread = threading.Thread(target=http.serve_forever, args=(0.02,), daemon=True)
        thread.start()
        try:
            yield server
        finally:
            server.released.set()
            http.shutdown()
            thread.join()


def wait_for(condition: object, seconds: float = 10.0) -> bool:
    """Wait until a condition is true; whether it is."""
    limit = time.monotonic() + seconds
    while not condition() and time.monotonic() < limit:  # type: ignore[operator]
        time.sleep(0.01)
    return bool(condition())  # type: ignore[operator]


def main() -> None:
    """Serve a folder until the standard input ends, and print its address first."""
    with store_server(Path(sys.argv[1])) as server:
        print(server.url, flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main()
