"""One page's application: a restricted `s2r tui` in a process of its own, behind pipes."""

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
from s2rtui.web.protocol import LARGEST_PACKET, meta

PATIENCE = 1.0
"""Seconds that a session may take to end in good order."""
_READY = b"__GANGLION__\n"
_PRELUDE_LINES = 10
_MOST_WAITING = 1 << 18
"""Bytes of input that wait for a busy session; more is dropped."""
_TOLD = 2000
"""Bytes of a failed session's last words that are shown."""

Send = Callable[[bytes], Awaitable[None]]


class PageSession:
    """The application process behind one page: call `start`, then `forward`, then `end`."""

    def __init__(self, process: Process) -> None:
        self._process, self._killed = process, False
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        self._stdin, self._stdout = process.stdin, process.stdout
        self._last_words = b""
        self._listening = asyncio.create_task(self._listen(process.stderr))

    @classmethod
    async def start(cls, store: Path, size: tuple[int, int]) -> PageSession:
        """A session on `store` of `size` columns and rows."""
        environment = {
            **os.environ, "TEXTUAL_DRIVER": WEB_DRIVER, "TEXTUAL_COLOR_SYSTEM": "truecolor",
            SERVER_VARIABLE: str(os.getpid()), "COLUMNS": str(size[0]), "ROWS": str(size[1]),
        }  # fmt: skip
        words = [sys.executable, "-P", "-m", "s2rtui", "tui", "--restricted", str(store.absolute())]
        return cls(
            await asyncio.create_subprocess_exec(
                *words, stdin=PIPE, stdout=PIPE, stderr=PIPE, env=environment,
                start_new_session=True,
            )
        )  # fmt: skip

    async def _listen(self, errors: asyncio.StreamReader) -> None:
        while words := await errors.read(4096):
            self._last_words = (self._last_words + words)[-_TOLD:]

    def write(self, packet: bytes) -> None:
        """Hand over input; dropped where the session has not read what it was given before."""
        waiting = self._stdin.transport.get_write_buffer_size()
        if waiting <= _MOST_WAITING and not self._stdin.is_closing():
            self._stdin.write(packet)

    async def forward(self, send: Send) -> None:
        """Pass on what the session draws until it says that it is over, or ends."""
        with suppress(asyncio.IncompleteReadError, ConnectionError, ValueError):
            for _ in range(_PRELUDE_LINES):
                if await self._stdout.readline() == _READY:
                    break
            while True:
                head = await self._stdout.readexactly(5)
                length = int.from_bytes(head[1:], "big")
                if length > LARGEST_PACKET:
                    return
                payload = await self._stdout.readexactly(length)
                if head[:1] == b"D":
                    await send(payload)
                elif head[:1] == b"M" and json.loads(payload).get("type") == "exit":
                    return

    async def end(self) -> None:
        """Ask the session to end, kill what is left of it, and say why where it had failed."""
        try:
            self.write(meta("quit"))
            await asyncio.wait_for(asyncio.gather(self._drop_output(), self._ended()), PATIENCE)
        except TimeoutError:
            self._kill()
            await self._ended()
        finally:
            self._kill()
        self._listening.cancel()
        if self._process.returncode and self._last_words and not self._killed:
            told = self._last_words.decode(errors="replace").strip().splitlines() or [""]
            print(f"s2r: a session ended: {printable(told[-1])}", file=sys.stderr)

    async def _drop_output(self) -> None:
        while await self._stdout.read(1 << 16):
            pass

    async def _ended(self) -> None:
        await self._process.wait()

    def _kill(self) -> None:
        """End the process and all that it has started, if it still runs."""
        if self._process.returncode is None:
            self._killed = True
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
