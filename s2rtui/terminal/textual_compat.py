"""What the application needs of Textual beyond its public interface: bounds on a terminal.

Written against the version that `pyproject.toml` pins. Every private name is used here, with the
reason beside it.
"""

from __future__ import annotations

import asyncio
import shutil
from codecs import IncrementalDecoder, getincrementaldecoder
from collections.abc import Iterable
from concurrent.futures import Future
from contextlib import suppress
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any

from textual import events
from textual._xterm_parser import BRACKETED_PASTE_END, XTermParser
from textual.driver import Driver
from textual.geometry import Size
from textual.message import Message

from s2rtui.terminal.size_limits import within_bounds

if TYPE_CHECKING:
    from textual.app import App

_LONGEST_PASTE = 1 << 16
"""Characters; a terminal that begins a paste and does not end it would fill the memory."""
_MOUSE = ("terminal_size", "terminal_pixel_size", "mouse_pixels")
"""Attributes of Textual's parser: how the terminal's pixels become cells."""
_BATCH = 128
"""Messages that are sent before the application is waited for."""


class _BoundedParser(XTermParser):
    """Drops a paste that is too long; Textual has no option for this and keeps all of it."""

    def __init__(self, debug: bool = False) -> None:
        super().__init__(debug)
        self._pending = 0
        self._dropped: str | None = None

    def feed(self, data: str) -> Iterable[Message]:
        """Events of what was read. Only a paste is long without becoming one."""
        if self._dropped is not None:
            data = self._after_paste(self._dropped + data)
        self._pending += len(data)
        for message in super().feed(data) if data or self._dropped is None else ():
            self._pending = 0
            yield message
        if self._pending > _LONGEST_PASTE:
            self._begin_anew()
            self._dropped = data[-len(BRACKETED_PASTE_END) :]

    def _after_paste(self, data: str) -> str:
        """What follows the end of a paste that is dropped; empty where it goes on."""
        _, end, rest = data.partition(BRACKETED_PASTE_END)
        self._dropped = None if end else data[1 - len(BRACKETED_PASTE_END) :]
        return rest

    def _begin_anew(self) -> None:
        """Forget the paste but not what is known of the terminal's mouse."""
        known = {name: vars(self)[name] for name in _MOUSE}
        XTermParser.__init__(self)
        for name, value in known.items():
            setattr(self, name, value)
        self._pending = 0


class _BoundedDriver(Driver):
    """Tells the application a size within bounds, and reads no faster than it can follow."""

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
        """Wait now and then until the application has taken what was sent: queues have no end."""
        self._sent += 1
        if self._sent % _BATCH:
            return
        turned: Future[None] | None = None
        while not self._has_ended():
            if turned is None:
                if self._loop.is_closed():
                    return
                turned = asyncio.run_coroutine_threadsafe(asyncio.sleep(0.001), self._loop)
            with suppress(TimeoutError):
                turned.result(0.05)
                if self._app.message_queue_size < _BATCH:
                    return
                turned = None

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
