"""Run the application on a terminal, and report unfinished work at its end."""

from __future__ import annotations

import contextlib
import sys
from typing import TYPE_CHECKING

from textual.drivers.linux_driver import LinuxDriver

from s2rstore.errors import S2RError
from s2rtui.app.app import S2RApp
from s2rtui.app.process_signals import terminal_mode
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import ColourMode
from s2rtui.jobs import background_thread
from s2rtui.security import Permissions
from s2rtui.session.session import Session
from s2rtui.terminal.capabilities import Terminal
from s2rtui.user_data import is_first_start

if TYPE_CHECKING:
    from s2rtui.terminal.graphics.protocols import Graphics

_SHUTDOWN_SECONDS = 0.3
"""How long background work may take after the application is closed."""


def run_app(
    session: Session, terminal: Terminal, access: Permissions, safe_csv: bool = False
) -> None:
    """Run the application on a session until the user quits; list unfinished work on stderr.

    Raises S2RError if the application fails.
    """
    app = S2RApp(session, terminal.render_options, access=access)
    app.export.safe_csv = safe_csv
    app.is_first_start, app.terminal = is_first_start(), terminal
    if terminal.graphics is not None:
        enable_inline_images(app, terminal.graphics)
    terminal_mode.remember()
    app.run(mouse=terminal.mode is not ColourMode.NONE)
    background_thread.wait_until_idle(_SHUTDOWN_SECONDS)
    with contextlib.suppress(OSError):  # the terminal may be gone
        for line in app.jobs.unfinished:
            print(f"s2r: {line}", file=sys.stderr)
    if app.fault is not None:
        raise S2RError(f"{type(app.fault).__name__}: {app.fault}") from app.fault


def enable_inline_images(app: S2RApp, graphics: Graphics) -> None:
    """Show images in true pixels once the application runs, or say why that is impossible."""
    from s2rtui.terminal.graphics.inline_images import ImageManager

    if not graphics.supported:
        app.session.show_message(f"--graphics: images are drawn in cells: {graphics.reason}")
        return

    def attach_all() -> None:
        for plot in app.query(PlotView):
            plot.attach_images()

    def on_ready() -> None:
        with contextlib.suppress(RuntimeError):  # the event loop is closed
            app.call_later(attach_all)

    def report_error(error: Exception) -> None:
        app.run_on_ui(app.show_error, f"inline images: {type(error).__name__}: {error}")

    images = ImageManager(graphics, app.write_to_terminal, on_ready, report_error)

    class Driver(LinuxDriver):
        """Deletes the images when the application leaves the terminal's screen."""

        def start_application_mode(self) -> None:
            super().start_application_mode()
            app.call_later(attach_all)

        def stop_application_mode(self) -> None:
            images.delete_all()
            super().stop_application_mode()

    app.image_host, app.driver_class = images, Driver
