"""What the parts of the application share: the session, the look, and drawing anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Any

from textual.filter import LineFilter
from textual.message import Message

from s2rtui.app.action_guard import GuardedApp
from s2rtui.app.messages import BackgroundFailed
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import Resources, Scene
from s2rtui.charts.view import View
from s2rtui.jobs.background_thread import start
from s2rtui.jobs.precompute_job import PrecomputeJob
from s2rtui.session import Session
from s2rtui.terminal.ascii_filter import AsciiFilter

_ASCII = AsciiFilter()


class Desk(GuardedApp):
    """One session and what workers have brought for it."""

    session: Session
    look: RenderOptions
    resources: Resources

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.under_way: dict[object, str] = {}

    @property
    def fault(self) -> Exception | None:
        """What ended the application before its time."""
        return self._exception

    def _fatal_error(self) -> None:
        """Without a traceback on the terminal: `run_app` raises what it was."""
        self._close_messages_no_wait()

    def _print_error_renderables(self) -> None:
        """See `_fatal_error`."""

    @property
    def undone(self) -> tuple[str, ...]:
        """What the user left before it was done, a line each."""
        return tuple(self.under_way.values())

    def post(self, message: Message) -> None:
        """From any thread, also when nobody listens any more."""
        with suppress(RuntimeError):  # the loop is closed
            self.post_message(message)

    def in_background(self, work: Callable[[], None], undone: str) -> None:
        """Do some work in a thread of its own; `undone` says what lacks where it does not end."""
        token = object()
        self.under_way[token] = undone

        def done() -> None:
            try:
                work()
            except Exception as error:  # whatever it was, the screen goes on and says so
                if not self.is_running:
                    return
                told = " ".join(str(error).split())
                self.post(BackgroundFailed(f"{undone} ({type(error).__name__}: {told})"))
            del self.under_way[token]

        start(undone, done)

    def on_background_failed(self, message: BackgroundFailed) -> None:
        self.tell_refusal(message.text)

    @property
    def scene(self) -> Scene:
        """What the views are drawn from now."""
        return Scene(self.session.store, self.session.state, self.resources, self.session.notes)

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Textual's filters, and ours where only ASCII is allowed."""
        filters = super().get_line_filters()
        return [*filters, _ASCII] if self.look.ascii else filters

    @property
    def active(self) -> View:
        """The view that keys speak to."""
        return BY_NAME[self.session.state.view]

    def refresh_views(self) -> None:
        """Draw the current state everywhere, and ask workers for what it lacks."""
        raise NotImplementedError

    def show_message(self) -> None:
        """Draw the line of messages alone."""
        raise NotImplementedError

    def begin_saving(self, name: str, start: Callable[[], PrecomputeJob]) -> None:
        """Save a run in the background, and show how far it is."""
        raise NotImplementedError

    @property
    def saving_refusal(self) -> str:
        """Why no run can be saved now; empty where one can."""
        raise NotImplementedError

    def tell_refusal(self, told: str) -> None:
        self.session.tell(told, is_error=True)
        self.refresh_views()

    def refuse(self, error: Exception) -> None:
        """Show what went wrong."""
        self.tell_refusal(str(error))
