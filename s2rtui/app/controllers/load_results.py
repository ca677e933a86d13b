"""Apply the results of background loading, and check for new generations."""

from __future__ import annotations

from dataclasses import replace

from s2rstore.errors import RequestError, S2RError
from s2rstore.reader import Store
from s2rtui.app.controllers.host import ControllerHost
from s2rtui.app.controllers.run_save import RunSaveController
from s2rtui.app.load_scheduler import LoadScheduler
from s2rtui.app.messages import LoadCompleted, LoadProgressed
from s2rtui.session import navigation


class LoadResultController:
    """Passes results to the session and the resources; outdated ones are dropped."""

    def __init__(
        self, host: ControllerHost, scheduler: LoadScheduler, run_save: RunSaveController
    ) -> None:
        self._host, self._scheduler, self._run_save = host, scheduler, run_save
        self._store_error = ""

    def on_completed(self, message: LoadCompleted) -> None:
        """Apply a result; one that is no longer requested is dropped."""
        host, fresh = self._host, message.fields.pop("store", None)
        if not self._scheduler.accept(message):
            if fresh is not None:
                fresh.close()
            return
        if message.loader == "run":
            self._complete_pending(message.error, fresh)
        elif message.error:
            host.session.show_message(message.error, is_error=True)
        host.resources = host.resources.with_loaded(message.loader, message.fields, message.error)
        host.renderer.refresh()

    def _complete_pending(self, error: str, fresh: Store | None) -> None:
        """Show the pending target, or say why it cannot be loaded."""
        session = self._host.session
        try:
            if error:
                raise RequestError(error)
            session.complete_pending(fresh)
            self._run_save.announce()
        except S2RError as reason:
            session.dispatch(navigation.cancel_pending, str(reason))

    def on_progressed(self, message: LoadProgressed) -> None:
        """Show the share of a loader's work that is done."""
        if not self._scheduler.is_newest(message.loader, message.ticket):
            return
        resources = self._host.resources
        progress = {**resources.progress, message.loader: message.share}
        self._host.resources = replace(resources, progress=progress)
        self._host.renderer.refresh_message()

    def check_store(self) -> None:
        """Close stores that nothing reads, and look for a newer generation or gap history."""
        session = self._host.session
        if self._scheduler.idle and not self._host.jobs.unfinished:
            session.close_retired_stores()
        has_updates, error = False, ""
        try:
            has_updates = session.check_for_updates()
        except (S2RError, OSError) as reason:
            error = str(reason)
        if error != self._store_error:
            self._show_store_error(error)
        if has_updates:
            self._host.renderer.refresh()

    def _show_store_error(self, error: str) -> None:
        """Show once that the store cannot be read, and clear that once it can."""
        session, before, self._store_error = self._host.session, self._store_error, error
        if error:
            session.show_message(error, is_error=True)
        elif session.state.is_error and session.state.message == before:
            session.show_message("")
        self._host.renderer.refresh_message()
