"""Runs feeds in worker threads for an application: newest request wins, nothing blocks."""

from __future__ import annotations

import traceback
from functools import partial
from typing import Any

from textual.app import App
from textual.timer import Timer

from s2rstore.errors import S2RError
from s2rstore.reader import Store
from s2rtui.feeds import FEEDS, Feed, Key
from s2rtui.messages import Fed, Progressed
from s2rtui.session.state import State

REST_SECONDS = 0.15


class Feeding:
    """The requests under way, one per feed."""

    def __init__(self, app: App[Any]) -> None:
        self._app = app
        self._wanted: dict[str, Key | None] = {}
        self._ticket: dict[str, int] = {feed.name: 0 for feed in FEEDS}
        self._answered: dict[str, int] = {feed.name: 0 for feed in FEEDS}
        self._rest: dict[str, Timer] = {}
        self.rest_seconds = REST_SECONDS

    @property
    def settled(self) -> bool:
        """Whether all that was wanted has come."""
        return self._answered == self._ticket

    def ask(self, store: Store, state: State) -> dict[str, Any]:
        """Start what the state wants anew; gives the fields that are empty from now on."""
        emptied: dict[str, Any] = {}
        for feed in FEEDS:
            wanted = feed.wants(store, state)
            if feed.name in self._wanted and wanted == self._wanted[feed.name]:
                continue
            self._wanted[feed.name] = wanted
            self._ticket[feed.name] += 1
            if feed.name in self._rest:
                self._rest[feed.name].stop()
            if wanted is None:
                self._answered[feed.name] = self._ticket[feed.name]
                emptied.update(dict.fromkeys(feed.empty))
                continue
            start = partial(self._start, feed, self._ticket[feed.name], store, state)
            if feed.rests:
                self._rest[feed.name] = self._app.set_timer(self.rest_seconds, start)
            else:
                start()
        return emptied

    def _start(self, feed: Feed, ticket: int, store: Store, state: State) -> None:
        read = partial(self._read, feed, ticket, store, state)
        self._app.run_worker(read, group=feed.name, thread=True, exclusive=True)

    def _read(self, feed: Feed, ticket: int, store: Store, state: State) -> None:
        """In a worker's thread."""
        caller = _Caller(self, feed.name, ticket)
        if not caller.wanted():
            return
        try:
            fields = feed.read(store, state, caller)
        except Exception as error:  # whatever it was, the screen goes on and says so
            empty = dict.fromkeys(feed.empty)
            told = str(error) or type(error).__name__
            if not isinstance(error, S2RError | OSError | ValueError):
                self._app.log.error(traceback.format_exc())
                told = f"{feed.name}: {told}"
            self.post(Fed(feed.name, ticket, empty, " ".join(told.split())))
            return
        self.post(Fed(feed.name, ticket, fields))

    def current(self, feed: str, ticket: int) -> bool:
        """Whether a ticket is that of the newest request."""
        return ticket == self._ticket[feed]

    def post(self, message: Fed | Progressed) -> None:
        self._app.post_message(message)

    def stop(self) -> None:
        """Nothing is wanted any more."""
        for name in self._ticket:
            self._ticket[name] += 1

    def accept(self, message: Fed) -> bool:
        """Whether an answer is to the newest request."""
        if not self.current(message.feed, message.ticket):
            return False
        if not message.partly:
            self._answered[message.feed] = message.ticket
        return True


class _Caller:
    """One request of one feed, in its worker's thread."""

    def __init__(self, feeding: Feeding, feed: str, ticket: int) -> None:
        self._feeding, self._feed, self._ticket = feeding, feed, ticket

    def wanted(self) -> bool:
        return self._feeding.current(self._feed, self._ticket)

    def progress(self, share: float) -> bool:
        wanted = self.wanted()
        if wanted and share < 1:
            self._feeding.post(Progressed(self._feed, self._ticket, share))
        return wanted

    def bring(self, fields: dict[str, Any]) -> None:
        if self.wanted():
            self._feeding.post(Fed(self._feed, self._ticket, fields, partly=True))
