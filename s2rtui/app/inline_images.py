"""Set up inline images in true pixels for an application."""

from __future__ import annotations

from contextlib import suppress

from textual.drivers.linux_driver import LinuxDriver

from s2rtui.app.app import S2RApp
from s2rtui.app.widgets.plot import PlotView
from s2rtui.terminal.graphics.image_manager import ImageManager
from s2rtui.terminal.graphics.protocols import Graphics


def enable_inline_images(app: S2RApp, graphics: Graphics) -> None:
    """Show images in true pixels once the application runs, or say why that is impossible."""
    if not graphics.supported:
        app.session.show_message(f"--graphics: images are drawn in cells: {graphics.reason}")
        return

    def attach_all() -> None:
        for plot in app.query(PlotView):
            plot.attach_images()

    def on_ready() -> None:
        with suppress(RuntimeError):  # the event loop is closed
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
