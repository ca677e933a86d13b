"""The application of one page: a restricted `s2r tui` in a subprocess, connected by pipes."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Awaitable, Callable
from contextlib import suppress
from pathlib import Path

from s2rstore.security.printable_text import printable
from s2rtui.security.restricted_process import SERVER_VARIABLE, WEB_DRIVER
from s2rtui.web.protocol import MAX_PACKET_BYTES, meta

EXIT_TIMEOUT = 1.0
"""Time in seconds for a session to end regularly."""
_START_MARKER = b"__GANGLION__\n"
_MAX_LINES_BEFORE_START = 10
_MAX_QUEUED_BYTES = 1 << 18
"""Input that is queued for a busy session; more is dropped."""
_MAX_ERROR_BYTES = 2000
"""Size of the end of standard error that the message about a failure is taken from."""

Send = Callable[[bytes], Awaitable[None]]


class PageSession:
    """The application process behind one page: call `start`, then `forward`, then `end`."""

    def __init__(self, process: Process) -> None:
        self._process, self._killed = process, False
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self._stdin, self._stdout = process.stdin, process.stdout
        self._errors = b""
        self._error_reader = asyncio.create_task(self._read_errors(process.stderr))

    @classmethod
    async def start(cls, store: Path, size: tuple[int, int]) -> PageSession:
        """Start a session on `store` with `size` columns and rows."""
        environment = {
            **os.environ, "TEXTUAL_DRIVER": WEB_DRIVER, "TEXTUAL_COLOR_SYSTEM": "truecolor",
            SERVER_VARIABLE: str(os.getpid()), "COLUMNS": str(size[0]), "ROWS": str(size[1]),
        }  # fmt: skip
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-m", "s2rtui", "tui", "--restricted", str(store.absolute()),
            stdin=PIPE, stdout=PIPE, stderr=PIPE, env=environment, start_new_session=True,
        )  # fmt: skip
        return cls(process)

    async def _read_errors(self, errors: asyncio.StreamReader) -> None:
        while chunk := await errors.read(4096):
            self._errors = (self._errors + chunk)[-_MAX_ERROR_BYTES:]

    def write(self, packet: bytes) -> None:
        """Send input to the session; drop it if too much input is queued."""
        queued = self._stdin.transport.get_write_buffer_size()
        if queued <= _MAX_QUEUED_BYTES and not self._stdin.is_closing():
            self._stdin.write(packet)

    async def forward(self, send: Send) -> None:
        """Forward the output of the session until it ends."""
        with suppress(asyncio.IncompleteReadError, ConnectionError, ValueError):
            for _ in range(_MAX_LINES_BEFORE_START):
                if await self._stdout.readline() == _START_MARKER:
                    break
            while True:
                head = await self._stdout.readexactly(5)
                length = int.from_bytes(head[1:], "big")
                if length > MAX_PACKET_BYTES:
                    return
                payload = await self._stdout.readexactly(length)
                if head[:1] == b"D":
                    await send(payload)
                elif head[:1] == b"M" and json.loads(payload).get("type") == "exit":
                    return

    async def end(self) -> None:
        """Ask the session to quit, kill remaining processes, and report a failure."""
        try:
            self.write(meta("quit"))
            await asyncio.wait_for(
                asyncio.gather(self._drop_output(), self._process.wait()), EXIT_TIMEOUT
            )
        except TimeoutError:
            self._kill()
            await self._process.wait()
        finally:
            self._kill()
        self._error_reader.cancel()
        if self._process.returncode and self._errors and not self._killed:
            lines = self._errors.decode(errors="replace").strip().splitlines() or [""]
            print(f"s2r: a session failed: {printable(lines[-1])}", file=sys.stderr)

    async def _drop_output(self) -> None:
        while await self._stdout.read(1 << 16):
            pass

    def _kill(self) -> None:
        if self._process.returncode is None:
            self._killed = True
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
