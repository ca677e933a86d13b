"""Shows by itself: the selected instances one after another, and both sides in turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.timer import Timer

from s2rtui.session import images, navigation

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

SPEEDS = (2, 5, 15)
"""Instances per second, in the order in which the key goes through them."""
BLINK_SECONDS = 0.6
"""Time for which each side is shown where both are shown in turn."""


class PlayerController:
    """Moves the cursor to the next instance at a regular time, until the last one."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._timer: Timer | None = None
        self._speed = 0
        self._blinking: Timer | None = None

    @property
    def is_playing(self) -> bool:
        return self._timer is not None

    def change_speed(self) -> None:
        """Play, play faster, and stop after the fastest speed."""
        speed = next((speed for speed in SPEEDS if speed > self._speed), 0)
        self.stop()
        message = "playing has stopped"
        if speed:
            following = "stops" if speed == SPEEDS[-1] else "plays faster"
            self._speed = speed
            self._timer = self._app.set_interval(1 / speed, self.step)
            message = f"playing {speed} instances a second; ' {following}"
        self._app.session.show_message(message)

    def step(self) -> None:
        """Go to the next instance and keep the message; stop at the last instance."""
        session = self._app.session
        before = session.state.cursor
        session.dispatch(navigation.play_on)
        if session.state.cursor == before:
            self.stop()
        self._app.updater.refresh()

    def change_arrangement(self) -> None:
        """Arrange both sides of the instance in another way; those in turn change by themselves."""
        session = self._app.session
        session.dispatch(images.change_arrangement)
        if self._blinking is not None:
            self._blinking.stop()
            self._blinking = None
        if session.state.images.arrangement == "blink":
            self._blinking = self._app.set_interval(BLINK_SECONDS, self.blink)

    def blink(self) -> None:
        """Show the other side."""
        self._app.session.dispatch(images.swap_front)
        self._app.updater.refresh()

    def stop(self) -> None:
        if self._timer is not None:
            self._timer.stop()
        self._timer, self._speed = None, 0
