"""Shows by itself: instances one after another, a drive over time, and both sides in turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.timer import Timer

from s2rtui.charts.registry import BY_NAME
from s2rtui.session import images

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

SPEEDS = (2, 5, 15)
"""Steps per second, in the order in which the key goes through them."""
_PLAYING = "playing "
BLINK_SECONDS = 0.6
"""Time for which each side is shown where both are shown in turn."""


class PlayerController:
    """Lets the active view go on at a regular time, until its last instance or moment."""

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
            message = f"{_PLAYING}{speed} steps a second; ' {following}"
        self._app.session.show_message(message)

    def step(self) -> None:
        """Show what follows and keep the message; stop at the end."""
        session = self._app.session
        if not self._app.prompt.is_open and not self.move(1):
            self.stop()
            if session.state.message.startswith(_PLAYING):
                session.show_message("")
        self._app.updater.refresh()

    def move(self, steps: int) -> bool:
        """Let the active view go on by steps; False at its end."""
        scene = self._app.updater.scene
        return BY_NAME[scene.state.view].play(self._app.session, scene, steps)

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
