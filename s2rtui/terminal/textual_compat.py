"""All uses of Textual's private interface, each with its reason.

Written against the version of Textual that `pyproject.toml` pins.
"""

from __future__ import annotations

import asyncio
import shutil
from codecs import IncrementalDecoder, getincrementaldecoder
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import partial
from types import ModuleType
from typing import Any

from rich.console import Console
from rich.segment import Segment
from textual import events
from textual._xterm_parser import BRACKETED_PASTE_END, XTermParser
from textual.app import App
from textual.driver import Driver
from textual.geometry import Size
from textual.message import Message
from textual.message_pump import MessagePump
from textual.screen import Screen
from textual.strip import Strip

from s2rtui.terminal.capabilities import within_bounds

_MAX_PASTE = 1 << 16
"""Characters; an unterminated paste would otherwise fill the memory."""
_MOUSE_ATTRIBUTES = ("terminal_size", "terminal_pixel_size", "mouse_pixels")
"""Attributes of Textual's parser: how the terminal's pixels become cells."""
_BATCH = 128
"""Messages sent before waiting for the application."""


class QuietApp(App[None]):
    """An application on a bounded driver that stores a fault instead of printing its traceback."""

    @property
    def fault(self) -> Exception | None:
        """The exception that ended the application; Textual stores it in `_exception` alone."""
        return self._exception

    def surviving_errors(self) -> AbstractContextManager[None]:
        """A context whose errors are shown and do not end the application."""
        raise NotImplementedError

    async def _on_message(self, message: Message) -> None:
        """Textual calls the handlers here, and ends the application if one of them fails.

        Errors in handlers of events, such as mounting and resizing, still end it.
        """
        is_event = isinstance(message, events.Event)
        with nullcontext() if is_event else self.surviving_errors():
            await super()._on_message(message)

    def _fatal_error(self) -> None:
        """Textual prints a traceback here; `run_app` reports `fault` in one line instead."""
        self._close_messages_no_wait()  # the rest of what `_fatal_error` does

    def _print_error_renderables(self) -> None:
        """Textual prints tracebacks here at exit; see `_fatal_error`."""

    def get_driver_class(self) -> type[Driver]:
        return bounded(super().get_driver_class())

    def write_to_terminal(self, text: str) -> None:
        """Write control sequences; only `_driver` reaches the terminal past the compositor."""
        if self._driver is not None:
            self._driver.write(text)


def screen_strips(screen: Screen[Any]) -> list[Strip]:
    """The visible lines of a screen; only the compositor has them as text with styles."""
    return screen._compositor.render_strips()


class LazyStrip(Strip):
    """A strip that makes its segments and its escape codes only when they are needed.

    Textual's strips hold segments in `_segments` and codes in `_render_cache`, and have no public
    way to compute either late.
    """

    __slots__ = ("_lazy_segments",)

    def __init__(self, cell_length: int) -> None:
        self._lazy_segments: list[Segment] | None = None
        super().__init__((), cell_length)

    def make_segments(self) -> list[Segment]:
        """The styled text of the strip."""
        raise NotImplementedError

    def encode(self) -> str:
        """The text with escape codes."""
        raise NotImplementedError

    @property
    def _segments(self) -> list[Segment]:
        if self._lazy_segments is None:
            self._lazy_segments = self.make_segments()
        return self._lazy_segments

    @_segments.setter
    def _segments(self, empty: list[Segment]) -> None:
        """The base class assigns an empty list at the start."""

    def render(self, console: Console) -> str:
        if self._render_cache is None:
            self._render_cache = self.encode()
        return self._render_cache


class _BoundedParser(XTermParser):
    """Drops a paste that is too long; Textual has no such limit and keeps all of it in memory."""

    def __init__(self, debug: bool = False) -> None:
        super().__init__(debug)
        self._pending = 0
        self._dropped: str | None = None

    def feed(self, data: str) -> Iterable[Message]:
        """Parse input into events; only a paste can be long without yielding one."""
        if self._dropped is not None:
            data = self._after_paste(self._dropped + data)
        self._pending += len(data)
        for message in super().feed(data) if data or self._dropped is None else ():
            self._pending = 0
            yield message
        if self._pending > _MAX_PASTE:
            self._reset()
            self._dropped = data[-len(BRACKETED_PASTE_END) :]

    def _after_paste(self, data: str) -> str:
        """What follows the end of a dropped paste; empty if it has not ended."""
        _, end, rest = data.partition(BRACKETED_PASTE_END)
        self._dropped = None if end else data[1 - len(BRACKETED_PASTE_END) :]
        return rest

    def _reset(self) -> None:
        """Drop the paste, but keep the parser's pixel sizes for the mouse."""
        mouse = {name: vars(self)[name] for name in _MOUSE_ATTRIBUTES}
        XTermParser.__init__(self)
        for name, value in mouse.items():
            setattr(self, name, value)
        self._pending = 0


class _BoundedDriver(Driver):
    """Bounds the terminal size, and reads input no faster than the application handles it."""

    def __init__(
        self,
        app: App[Any],
        *,
        debug: bool = False,
        mouse: bool = True,
        size: tuple[int, int] | None = None,
    ) -> None:
        super().__init__(app, debug=debug, mouse=mouse, size=size)
        # App.size reads `_size` before the first resize event; None would mean Rich's own guess.
        self._size = within_bounds(*(self._size or shutil.get_terminal_size()))
        self._sent = 0

    def process_message(self, message: Message) -> None:
        """Bound the size in resize events. Called in the thread that reads the input."""
        if isinstance(message, events.Resize):
            size = Size(*within_bounds(*message.size))
            message = events.Resize(size, size, size, message.pixel_size)
        super().process_message(message)
        self._keep_pace()

    def _keep_pace(self) -> None:
        """Wait until the application has handled most messages: its queue is unbounded."""
        self._sent += 1
        if self._sent % _BATCH:
            return
        tick: Future[None] | None = None
        while not self._has_ended():
            if tick is None:
                if self._loop.is_closed():
                    return
                tick = asyncio.run_coroutine_threadsafe(asyncio.sleep(0.001), self._loop)
            with suppress(TimeoutError):
                tick.result(0.05)
                if self._app.message_queue_size < _BATCH:
                    return
                tick = None

    def _has_ended(self) -> bool:
        """Whether the driver is being stopped, which waits for the thread that reads."""
        return bool(vars(self)["exit_event"].is_set())


def bounded(driver: type[Driver]) -> type[Driver]:
    """A driver for the application in place of Textual's `driver`."""
    from textual.drivers.linux_driver import LinuxDriver

    if driver is LinuxDriver:
        return _terminal_driver()
    if driver.__module__ == "textual.drivers.web_driver":
        return _web_driver()
    return driver


def _terminal_driver() -> type[Driver]:
    from textual.drivers import linux_driver

    _read_safely(linux_driver)

    class TerminalDriver(_BoundedDriver, linux_driver.LinuxDriver):
        def _get_terminal_size(self) -> tuple[int, int]:
            """Where the size comes from at the start and at every SIGWINCH."""
            return within_bounds(*super()._get_terminal_size())

    return TerminalDriver


def _web_driver() -> type[Driver]:
    from textual.drivers import web_driver

    _read_safely(web_driver)

    class PageDriver(_BoundedDriver, web_driver.WebDriver):
        def on_meta(self, packet_type: str, payload: dict[str, object]) -> None:
            """Sizes from the page do not come through `process_message`."""
            if packet_type == "resize":
                width, height = within_bounds(int(str(payload["width"])),
                                              int(str(payload["height"])))  # fmt: skip
                payload = {**payload, "width": width, "height": height}
            super().on_meta(packet_type, payload)
            self._keep_pace()

    return PageDriver


def _read_safely(driver: ModuleType) -> None:
    """Replace a driver's input parser by a bounded one, and its decoder by one without errors.

    What is no UTF-8 becomes U+FFFD: the thread that reads keys would end the application. Both
    names are looked up in the module when that thread begins.
    """

    def lenient(encoding: str) -> partial[IncrementalDecoder]:
        return partial(getincrementaldecoder(encoding), errors="replace")

    vars(driver).update(getincrementaldecoder=lenient, XTermParser=_BoundedParser)


def call_after(
    pump: MessagePump, seconds: float, callback: Callable[[], object]
) -> asyncio.TimerHandle:
    """Call `callback` in a message pump after a delay, unless the handle is cancelled before.

    Textual's one-shot timers skip a call that is overdue, so that a process that was suspended for
    as long as the delay would lose the call.
    """
    return asyncio.get_running_loop().call_later(seconds, pump.call_next, callback)
