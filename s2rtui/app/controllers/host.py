"""What controllers need of the application."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from textual.message import Message
from textual.screen import Screen

from s2rtui.app.widgets.query_input import QueryInput
from s2rtui.canvas import RenderOptions
from s2rtui.charts.scene import Resources
from s2rtui.jobs.background_thread import BackgroundJobs
from s2rtui.security import Permissions
from s2rtui.session import Session

if TYPE_CHECKING:
    from s2rtui.app.renderer import Renderer


class ControllerHost(Protocol):
    """The application as controllers see it: its session and its services."""

    session: Session
    resources: Resources
    render_options: RenderOptions
    access: Permissions
    jobs: BackgroundJobs
    output_folder: Path
    renderer: Renderer

    @property
    def is_running(self) -> bool:
        """Whether the application still takes messages."""

    @property
    def screen(self) -> Screen[Any]:
        """The screen on top."""

    @property
    def query_line(self) -> QueryInput:
        """The input line at the foot."""

    def show_error(self, text: str) -> None:
        """Show an error in the message line."""

    def post(self, message: Message) -> None:
        """Post a message from any thread; ignored once the application has ended."""

    def open_screen(self, screen: Screen[Any], on_result: Callable[[Any], None]) -> None:
        """Open a modal screen and call `on_result` with what it returns."""

    def run_action_soon(self, action: str) -> None:
        """Run a Textual action once the present message is handled."""
