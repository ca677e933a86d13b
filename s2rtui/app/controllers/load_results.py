"""Apply the results of background loading."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError, S2RError
from s2rstore.reader import Store
from s2rtui.app.messages import LoadCompleted, LoadProgressed
from s2rtui.session import navigation

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp


class LoadResultController:
    """Passes results to the session and the resources; outdated ones are dropped."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app

    def on_completed(self, message: LoadCompleted) -> None:
        """Apply a result; one that is no longer requested is dropped."""
        app, fresh = self._app, message.fields.pop("store", None)
        if not app.load_scheduler.accept(message):
            if fresh is not None:
                fresh.close()
            return
        if message.loader == "run":
            self._complete_pending(message.error, fresh)
        elif message.error:
            app.session.show_message(message.error, is_error=True)
        app.loaded = app.loaded.with_loaded(message.loader, message.fields, message.error)
        app.updater.refresh()

    def _complete_pending(self, error: str, fresh: Store | None) -> None:
        """Show the pending target, or say why it cannot be loaded."""
        session = self._app.session
        try:
            if error:
                raise RequestError(error)
            session.complete_pending(fresh)
            self._app.adjust.announce()
        except S2RError as reason:
            session.dispatch(navigation.cancel_pending, str(reason))

    def on_progressed(self, message: LoadProgressed) -> None:
        """Show the share of a loader's work that is done."""
        if not self._app.load_scheduler.is_newest(message.loader, message.ticket):
            return
        resources = self._app.loaded
        progress = {**resources.progress, message.loader: message.share}
        self._app.loaded = replace(resources, progress=progress)
        self._app.updater.refresh_message()
