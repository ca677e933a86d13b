"""Run loaders in background threads, one per loader, and show what they read.

The newest request wins.
"""

from __future__ import annotations

import traceback
from asyncio import TimerHandle
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from s2rstore.errors import DamagedStoreError, RequestError, S2RError
from s2rstore.reader import Store
from s2rtui.jobs.background_thread import LatestOnlyWorker
from s2rtui.loaders import LOADERS, Fields, Key, LoadContext, Loader
from s2rtui.session import navigation
from s2rtui.session.state import State
from s2rtui.terminal.textual_compat import call_after

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

DEBOUNCE_SECONDS = 0.15
"""Delay before a debounced loader starts, so that it waits for repeated keys."""
RELEASE_SECONDS = 120.0
"""Delay after the last request until the resources of a loader are released."""


class LoadScheduler:
    """Per loader, the request that is being read and the newest one.

    `damage` is the message of the last file of the store that could not be read, if there was one.
    """

    def __init__(self, app: S2RApp) -> None:
        self.app = app
        self._workers = {
            loader.name: LatestOnlyWorker(loader.name, partial(self._report_failure, loader))
            for loader in LOADERS
        }
        self._requested: dict[str, Key | None] = {}
        self._ticket: dict[str, int] = {loader.name: 0 for loader in LOADERS}
        self._answered: dict[str, int] = {loader.name: 0 for loader in LOADERS}
        self._debounce: dict[str, TimerHandle] = {}
        self._release: dict[str, TimerHandle] = {}
        self.damage = ""
        self.debounce_seconds, self.release_seconds = DEBOUNCE_SECONDS, RELEASE_SECONDS

    @property
    def idle(self) -> bool:
        """Whether no thread reads anything or is about to."""
        return not self._debounce and all(worker.idle for worker in self._workers.values())

    @property
    def settled(self) -> bool:
        """Whether every request is answered."""
        return self._answered == self._ticket

    def request(self, store: Store, state: State) -> tuple[set[str], Fields]:
        """Start the loaders whose key differs from their last request.

        Returns the names of these loaders, and the fields to clear.
        """
        restarted: set[str] = set()
        cleared: Fields = {}
        for loader in LOADERS:
            key = loader.request_key(store, state)
            if loader.name in self._requested and key == self._requested[loader.name]:
                continue
            restarted.add(loader.name)
            self._requested[loader.name] = key
            self._ticket[loader.name] += 1
            for timers in (self._debounce, self._release):
                if loader.name in timers:
                    timers.pop(loader.name).cancel()
            if key is None:
                self._answered[loader.name] = self._ticket[loader.name]
                cleared |= dict.fromkeys(loader.cleared_fields)
                self._release_later(loader)
            else:
                self._start(loader, self._ticket[loader.name], store, state)
        return restarted, cleared

    def _start(self, loader: Loader, ticket: int, store: Store, state: State) -> None:
        read = partial(self._read, loader, ticket, store, state)
        if not loader.is_debounced:
            self._workers[loader.name].put(read)
            return

        def start() -> None:
            if self.is_newest(loader.name, ticket):
                del self._debounce[loader.name]  # a timer keeps its callback, and so the store
                self._workers[loader.name].put(read)

        self._debounce[loader.name] = call_after(self.app, self.debounce_seconds, start)

    def _release_later(self, loader: Loader) -> None:
        """Release the resources of a loader unless it is requested again soon."""
        if loader.release is not None and self._workers[loader.name].was_used:
            release = partial(self._workers[loader.name].put, loader.release)
            self._release[loader.name] = call_after(self.app, self.release_seconds, release)

    def _read(self, loader: Loader, ticket: int, store: Store, state: State) -> None:
        """Runs in the loader's thread."""
        context = _RequestContext(self, loader, ticket)
        if not context.is_current():
            return
        try:
            fields = loader.read(store, state, context)
        except Exception as error:  # reported on the screen, whatever it is
            cleared = dict.fromkeys(loader.cleared_fields)
            reason = str(error) or type(error).__name__
            if isinstance(error, DamagedStoreError):
                self.damage = reason
            if not isinstance(error, S2RError | OSError | ValueError):
                self.app.log.error(traceback.format_exc())
                reason = f"{loader.name}: {reason}"
            error_text = " ".join(reason.split())
            self.app.run_on_ui(self.complete, loader.name, ticket, cleared, error_text)
            return
        self.app.run_on_ui(self.complete, loader.name, ticket, fields)

    def _report_failure(self, loader: Loader, error: Exception) -> None:
        """Runs in the loader's thread, for errors outside of reading."""
        self.app.run_on_ui(self.app.show_error, f"{loader.name}: {type(error).__name__}: {error}")

    def is_newest(self, loader: str, ticket: int) -> bool:
        """Whether a ticket belongs to the loader's newest request."""
        return ticket == self._ticket[loader]

    def stop(self) -> None:
        """Cancel all requests; threads that are reading are not waited for."""
        for loader in LOADERS:
            self._ticket[loader.name] += 1
            self._workers[loader.name].end(loader.release)

    # --- results, on the UI thread ---------------------------------------------------------------

    def complete(
        self, loader: str, ticket: int, fields: Fields, error: str = "", is_partial: bool = False
    ) -> None:
        """Show fields of `LoadedData`, or the error that a loader ended with.

        More fields follow if they are partial. A result that is no longer requested is dropped.
        """
        app, fresh = self.app, fields.pop("store", None)
        if not self._accepts(loader, ticket, is_partial):
            if fresh is not None:
                fresh.close()
            return
        if loader == "run":
            self._complete_pending(error, fresh)
        elif error:
            app.session.show_message(error, is_error=True)
        app.loaded = app.loaded.with_loaded(loader, fields, error)
        app.updater.refresh()

    def _accepts(self, loader: str, ticket: int, is_partial: bool) -> bool:
        """Whether a result is still requested; a partial one may be outdated."""
        if not self.is_newest(loader, ticket):
            return is_partial and self._requested[loader] is not None
        if not is_partial:
            self._answered[loader] = ticket
        return True

    def _complete_pending(self, error: str, fresh: Store | None) -> None:
        """Show the pending target, or say why it cannot be loaded."""
        session = self.app.session
        try:
            if error:
                raise RequestError(error)
            session.complete_pending(fresh)
            self.app.adjust.announce()
        except S2RError as reason:
            session.dispatch(navigation.cancel_pending, str(reason))

    def show_progress(self, loader: str, ticket: int, share: float) -> None:
        """Show the share (0 .. 1) of a loader's work that is done."""
        if self.is_newest(loader, ticket):
            progress = {**self.app.loaded.progress, loader: share}
            self.app.loaded = replace(self.app.loaded, progress=progress)
            self.app.updater.refresh_message()


class _RequestContext(LoadContext):
    """One request, used in the loader's thread."""

    def __init__(self, scheduler: LoadScheduler, loader: Loader, ticket: int) -> None:
        self._scheduler, self._loader, self._ticket = scheduler, loader, ticket

    def is_current(self) -> bool:
        return self._scheduler.is_newest(self._loader.name, self._ticket)

    def report_progress(self, share: float) -> bool:
        is_current = self.is_current()
        if is_current and share < 1:
            self._on_ui(self._scheduler.show_progress, share)
        return is_current

    def publish(self, fields: Fields) -> None:
        if self._loader.shows_outdated or self.is_current():
            self._on_ui(self._scheduler.complete, fields, "", True)

    def _on_ui(self, function: Callable[..., object], *arguments: object) -> None:
        run = self._scheduler.app.run_on_ui
        run(function, self._loader.name, self._ticket, *arguments)
