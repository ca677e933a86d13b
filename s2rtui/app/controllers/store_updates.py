"""Follow newer generations of the store; show what is computed in it, or why it is unreadable."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore.errors import S2RError
from s2rtui.jobs import background_thread
from s2rtui.session.session import StoreUpdates

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

CHECK_SECONDS = 2.0
"""Interval of the checks."""
REMOTE_CHECK_SECONDS = 10.0
"""Interval of the checks of a store on a server."""


class StoreUpdateController:
    """Checks the store at intervals; one on a server in a background thread."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._error = ""
        self._is_checking = False
        self._next_check = 0.0
        self.remote_check_seconds = REMOTE_CHECK_SECONDS

    def check_store(self) -> None:
        """Close stores that nothing reads, and look for a newer generation or gap history."""
        app, session = self._app, self._app.session
        if app.load_scheduler.idle and not app.jobs.unfinished:
            session.close_retired_stores()
        if not session.store.files.is_remote:
            self._apply(*self._check())
        elif not self._is_checking and time.monotonic() >= self._next_check:
            self._is_checking = True
            background_thread.run_in_thread(
                "store updates", lambda: app.run_on_ui(self._apply, *self._check())
            )

    def _check(self) -> tuple[StoreUpdates | None, str]:
        """What is published now, or an error; for any thread."""
        try:
            return self._app.session.read_updates(), ""
        except (S2RError, OSError) as reason:
            return None, str(reason)

    def _apply(self, updates: StoreUpdates | None, error: str) -> None:
        """Show what is new, or why the store cannot be read."""
        self._is_checking = False
        self._next_check = time.monotonic() + self.remote_check_seconds
        session, has_updates = self._app.session, False
        if updates is not None:
            try:
                has_updates = session.apply_updates(updates)
                has_updates |= session.follow(updates)
            except (S2RError, OSError) as reason:
                error = str(reason)
        has_updates |= self._show_computing(updates.computing if updates else "")
        if error != self._error:
            self._show_error(error)
        if has_updates:
            self._app.updater.refresh()

    def _show_computing(self, text: str) -> bool:
        """Show what another process computes in the store; whether that has changed."""
        loaded = self._app.loaded
        self._app.loaded = replace(loaded, computing=text)
        return text != loaded.computing

    def _show_error(self, error: str) -> None:
        """Show once that the store cannot be read, and clear the message once it can."""
        session, before, self._error = self._app.session, self._error, error
        if error:
            session.show_message(error, is_error=True)
        elif session.state.is_error and session.state.message == before:
            session.show_message("")
        self._app.updater.refresh_message()
