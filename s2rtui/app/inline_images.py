"""Pictures in true pixels in an application, from its start to its end."""

from __future__ import annotations

from contextlib import suppress

from textual.drivers.linux_driver import LinuxDriver

from s2rtui.app.app import S2RApp
from s2rtui.app.messages import BackgroundFailed
from s2rtui.app.widgets.plot import PlotView
from s2rtui.terminal.graphics.image_manager import KittyImageManager
from s2rtui.terminal.graphics.probe import Graphics


def hang(app: S2RApp, graphics: Graphics) -> None:
    """Give an application that is not yet running what the terminal draws, or say why not."""
    if not graphics.pictures:
        app.session.tell(f"--graphics: {graphics.told}; half blocks stay")
        return

    def write(text: str) -> None:
        if app._driver is not None:
            app._driver.write(text)

    def anew() -> None:
        for plot in app.query(PlotView):
            plot.hang()

    def ready() -> None:
        with suppress(RuntimeError):  # the loop is closed
            app.call_later(anew)

    def tell(error: Exception) -> None:
        app.post(BackgroundFailed(f"pictures: {type(error).__name__}: {error}"))

    wall = KittyImageManager(graphics, write, ready, tell)

    class Driver(LinuxDriver):
        """Leaves no picture behind in the screen that it leaves, for a while or for good."""

        def start_application_mode(self) -> None:
            super().start_application_mode()
            app.call_later(anew)

        def stop_application_mode(self) -> None:
            wall.take_down()
            super().stop_application_mode()

    app.wall, app.driver_class = wall, Driver
