"""Notice a newer generation of the store or a newer gap history, and a store that is unreadable."""

from __future__ import annotations

from typing import TYPE_CHECKING

from s2rstore.errors import S2RError

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

CHECK_SECONDS = 2.0
"""Interval of the checks."""


class StoreUpdateController:
    """Checks the store at intervals."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._error = ""

    def check_store(self) -> None:
        """Close stores that nothing reads, and look for a newer generation or gap history."""
        app, session = self._app, self._app.session
        if app.load_scheduler.idle and not app.jobs.unfinished:
            session.close_retired_stores()
        has_updates, error = False, ""
        try:
            has_updates = session.check_for_updates()
        except (S2RError, OSError) as reason:
            error = str(reason)
        if error != self._error:
            self._show_error(error)
        if has_updates:
            app.renderer.refresh()

    def _show_error(self, error: str) -> None:
        """Show once that the store cannot be read, and clear the message once it can."""
        session, before, self._error = self._app.session, self._error, error
        if error:
            session.show_message(error, is_error=True)
        elif session.state.is_error and session.state.message == before:
            session.show_message("")
        self._app.renderer.refresh_message()
