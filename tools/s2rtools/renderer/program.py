"""One renderer program: its start, its answers within a time limit, and its end."""

from __future__ import annotations

import os
import select
import shlex
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.security.printable_text import printable
from s2rtools.renderer.frames import RenderedFrame, read_frame
from s2rtools.renderer.protocol import (
    MOST_LINE,
    Answer,
    Bye,
    Hello,
    Message,
    Ready,
    RenderRequest,
    decode_answer,
    encode,
)

_END_SECONDS = 5.0
"""Seconds that a program has to end after `bye`."""
_SHOWN = 80


class RendererError(RequestError):
    """A renderer program that cannot be used: it broke the protocol or did not start."""


class RendererStoppedError(RendererError):
    """A renderer program that ended or did not answer in time; another start may help."""


class FrameFailedError(Exception):
    """The renderer states that it cannot render a frame; the text is its reason."""


_MOST_SHOWN = 200
"""Bytes of the standard error that a message shows."""


class RendererProgram:
    """A running renderer.

    `greet` comes first. At most one request may wait for its answer: `request`, then `wait`, then
    `frame`. After `wait`, the next request may be sent before `frame` reads the files of the one
    before, so that the program renders meanwhile.
    """

    def __init__(self, command: Sequence[str], camera: Hello, log: Path, timeout: float) -> None:
        """Start the program, which finds Python modules as one that the user starts.

        `log` receives its standard error; each answer may take `timeout` seconds. Raises
        RendererError where it cannot be started.
        """
        self.camera, self._log, self._timeout = camera, log, timeout
        self._name = shlex.join(command)
        self._rest = b""
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONSAFEPATH"}
        with log.open("ab") as errors:
            try:
                self._process = subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
                    bufsize=0, start_new_session=True, env=environment,
                )  # fmt: skip
            except OSError as error:
                reason = error.strerror or str(error)
                raise RendererError(
                    f"renderer {self._name}: cannot be started ({reason})"
                ) from error
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._input, self._output = self._process.stdin, self._process.stdout
        self._has_depth = True

    def greet(self) -> Ready:
        """Send the camera and wait for what the program declares.

        Raises RendererError where it does not answer as the protocol states.
        """
        self._send(Message(hello=self.camera))
        answer = self._answer()
        if answer.ready is None:
            raise self._broken("its first answer is not `ready`")
        self._has_depth = answer.ready.depth
        return answer.ready

    def request(self, request: RenderRequest) -> None:
        """Ask for a frame. `wait` reports a program that has ended."""
        self._send(Message(render=request))

    def wait(self, request: RenderRequest) -> None:
        """Wait until the program states that the frame is complete.

        Raises FrameFailedError where it states that it cannot render the frame, otherwise
        RendererError.
        """
        answer = self._answer()
        result = answer.rendered or answer.failed
        if result is None:
            raise self._broken("it answered `ready` to `render`")
        if result.id != request.id:
            raise self._broken(f"it answered with id {result.id}, not {request.id}")
        if answer.failed is not None:
            raise FrameFailedError(printable(answer.failed.reason))

    def frame(self, request: RenderRequest) -> RenderedFrame:
        """The checked files of a frame that is complete; they are removed from the folder.

        Raises RendererError where they are not what the protocol states.
        """
        depth = request.depth if self._has_depth else None
        try:
            return read_frame(self.camera, request.rgb, depth)
        except ValueError as error:
            raise self._broken(str(error)) from error
        finally:
            for name in (request.rgb, request.depth):
                with suppress(OSError):
                    os.unlink(Path(self.camera.folder) / name)

    def close(self) -> None:
        """Say goodbye; a program that does not end within 5 seconds is killed."""
        self._send(Message(bye=Bye()))
        with suppress(OSError):
            self._input.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_END_SECONDS)
        self.kill()

    def stop(self) -> None:
        """End the program and what it has started; a thread that waits for it goes on."""
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGKILL)

    def kill(self) -> None:
        """End the program and close its streams."""
        self.stop()
        self._process.wait()
        for stream in (self._input, self._output):
            with suppress(OSError):
                stream.close()

    def _send(self, message: Message) -> None:
        with suppress(OSError, ValueError):
            self._input.write(encode(message))

    def _answer(self) -> Answer:
        line = self._line()
        try:
            answer = decode_answer(line)
        except ValueError as error:
            shown = line[:_SHOWN].decode(errors="replace").strip()
            raise self._broken(f"it answered {shown!r} ({error})") from error
        given = [
            each for each in (answer.ready, answer.rendered, answer.failed) if each is not None
        ]
        if len(given) != 1:
            raise self._broken("an answer has one of the keys ready, rendered and failed")
        return answer

    def _line(self) -> bytes:
        """The next line that the program writes, within the time limit."""
        deadline = time.monotonic() + self._timeout
        poll = select.poll()
        poll.register(self._output, select.POLLIN)
        while b"\n" not in self._rest:
            if len(self._rest) > MOST_LINE:
                raise self._broken(f"it answered more than {MOST_LINE:,} bytes without a newline")
            remaining = deadline - time.monotonic()
            try:
                if remaining <= 0 or not poll.poll(1000 * remaining):
                    raise RendererStoppedError(
                        f"renderer {self._name}: no answer within {self._timeout:g} s{self._hint()}"
                    )
                block = os.read(self._output.fileno(), 1 << 16)
            except OSError as error:
                raise self._ended() from error
            if not block:
                raise self._ended()
            self._rest += block
        line, self._rest = self._rest.split(b"\n", 1)
        return line

    def _broken(self, what: str) -> RendererError:
        return RendererError(
            f"renderer {self._name}: broke the protocol: {printable(what)}{self._hint()}"
        )

    def _ended(self) -> RendererStoppedError:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        code = self._process.returncode
        how = "closed its output" if code is None else f"ended with exit code {code}"
        if code is not None and code < 0:
            how = f"was ended by signal {-code}"
        return RendererStoppedError(f"renderer {self._name}: {how}{self._hint()}")

    def _hint(self) -> str:
        """Where the standard error of the program is, with its last line."""
        if not (self._log.is_file() and self._log.stat().st_size):
            return ""
        with self._log.open("rb") as log:
            log.seek(max(0, self._log.stat().st_size - _MOST_SHOWN))
            lines = log.read().decode(errors="replace").split("\n")
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f": {printable(last)} (its standard error: {self._log})"
